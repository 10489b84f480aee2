// Condyle against fossa: constraint (e).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "anatomy/constraints.h"

namespace gnathion {
namespace {

const char* kNotChecked = "joints not checked: no CBCT";

std::string worse_text(const JointReport& r) {
  return r.tp.min_mm < 0.0
             ? fmt::format("the {} condyle would pass {:.2f} mm into its fossa ({:.2f} mm apart in MI)",
                           side_name(r.side), -r.tp.min_mm, r.mi.min_mm)
             : fmt::format("the {} condyle comes within {:.2f} mm of its fossa ({:.2f} mm in MI)",
                           side_name(r.side), r.tp.min_mm, r.mi.min_mm);
}

Constraint of_report(const JawsInTp& jaws, const char* name, const JointReport& r) {
  Constraint c = constraint_of(jaws.table, name);
  c.value = r.tp.min_mm;
  c.where_mm = r.tp.condyle_mm;
  c.gradient = gradient_at(c.where_mm, r.tp.normal);
  c.sigma = r.sigma_mm;
  return c;
}

}  // namespace

std::vector<JointReport> joint_reports(const JawsInTp& jaws, const std::optional<Matrix6>& covariance) {
  std::vector<JointReport> reports;
  const Matrix3& to_arch = jaws.arch.arch_from_dental.rotation;
  const auto add = [&](const std::optional<JointQuery>& joint, const Vector3& centre) {
    if (!joint) return;
    JointReport r;
    r.side = joint->joint().side;
    r.mi = joint->in_mi();
    r.tp = joint->at(jaws.therapeutic);
    r.condyle_path_mm = to_arch * (jaws.therapeutic * centre - centre);
    if (const auto variance = joint_variance_mm2(jaws.joints.known, r.tp, covariance))
      r.sigma_mm = std::sqrt(*variance);
    reports.push_back(r);
  };
  add(jaws.joints.left, jaws.condyle_left_mm);
  add(jaws.joints.right, jaws.condyle_right_mm);
  return reports;
}

std::vector<Constraint> joint_constraints(const JawsInTp& jaws, const std::vector<JointReport>& reports) {
  if (reports.empty()) {
    Constraint c = constraint_of(jaws.table, "condyle_fossa");
    c.checked = false;
    c.severity = Severity::kInforms;
    c.consequence = kNotChecked;
    return {c};
  }
  // Surfaces that overlap in MI itself (segmentation, registration) are held against MI, as the teeth are.
  const auto allowed = [&](const JointReport& r) {
    const double in_mi = std::min(0.0, r.mi.min_mm);
    return jaws.limits.condyle_fossa_mm + (in_mi < 0.0 ? in_mi - jaws.limits.overlap_beyond_mi_mm : 0.0);
  };
  const auto& hard = *std::min_element(reports.begin(), reports.end(), [&](const auto& a, const auto& b) {
    return a.tp.min_mm - allowed(a) < b.tp.min_mm - allowed(b);
  });
  const auto& near = *std::min_element(
      reports.begin(), reports.end(), [](const auto& a, const auto& b) { return a.tp.min_mm < b.tp.min_mm; });
  Constraint bone = of_report(jaws, "condyle_fossa", hard);
  bone.limit = allowed(hard);
  bone.pass = bone.value >= bone.limit;
  bone.consequence = bone.pass ? worse_text(hard) : worse_text(hard) + ": the joint forbids this position";
  if (reports.size() == 1)
    bone.consequence += fmt::format("; the {} joint was not checked",
                                    side_name(hard.side == Side::kLeft ? Side::kRight : Side::kLeft));
  Constraint space = of_report(jaws, "joint_space", near);
  space.pass = space.value >= space.limit;
  space.consequence =
      space.pass ? "the discs keep their room" : worse_text(near) + ": the disc would be pressed";
  return {bone, space};
}

}  // namespace gnathion
