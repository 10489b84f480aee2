#include "pipeline/check_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/mesh_io.h"
#include "pipeline/dental_motion.h"
#include "pipeline/nested_progress.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr double kShortReachMm = 8.0;  // a recording that opens less says little of what the jaw can do

std::vector<Rigid3> valid_motions(const JawMotion& motion) {
  std::vector<Rigid3> out;
  for (const JawMotionRow& row : motion.rows)
    if (row.valid) out.push_back(row.motion);
  return out;
}

/// How far the recording takes the incisal point.
double reach_of(const std::vector<Rigid3>& motions, const Vector3& point_mm) {
  double reach = 0.0;
  for (const Rigid3& m : motions) reach = std::max(reach, (m * point_mm - point_mm).norm());
  return reach;
}

}  // namespace

std::vector<std::string> KnowledgeFiles::paths() const {
  std::vector<std::string> out;
  for (const fs::path* p : {&cbct, &cbct_pose, &cbct_options.labels, &motion, &calibration})
    if (!p->empty()) out.push_back(p->string());
  return out;
}

std::vector<std::string> PatientFiles::paths() const {
  std::vector<std::string> out = KnowledgeFiles::paths();
  out.push_back(maxilla.string());
  out.push_back(mandible.string());
  return out;
}

Result<CbctOptions> cbct_options_of(const KnowledgeFiles& files) {
  CbctOptions options = files.cbct_options;
  if (files.cbct_pose.empty()) return options;
  GNATHION_CHECK_OK(read_cbct_registration(files.cbct_pose, options));
  return options;
}

namespace {

/// Joints that cannot be this patient's in MI: another frame, left for right, another bite, normals inside
/// out. Distances measured on them would be of something else.
Status plausible_joints(const RealizabilityChecker& checker, const Joints& joints, const fs::path& where) {
  constexpr double kDeepestInMiMm = 1.0, kWidestInMiMm = 10.0, kOffMm = 30.0;
  const auto refuse = [&](Side side, const std::string& why) {
    return bad_input("cannot check joints", where.string(),
                     fmt::format("{} joint: {}", side_name(side), why));
  };
  for (const auto& [known, query] :
       {std::pair(&joints.left, &checker.joints().left), std::pair(&joints.right, &checker.joints().right)}) {
    if (!*known) continue;
    const Joint& joint = **known;
    const double off_mm = (joint.centre_mm() - mean_condyle_mm(checker.arch(), joint.side)).norm();
    if (off_mm > kOffMm)
      return refuse(joint.side, fmt::format("its condyle is {:.0f} mm from where this arch has it: another "
                                            "frame, or left for right?",
                                            off_mm));
    const double in_mi_mm = (*query)->in_mi().min_mm;
    if (in_mi_mm < -kDeepestInMiMm || in_mi_mm > kWidestInMiMm)
      return refuse(joint.side,
                    fmt::format("in MI its condyle is {:.1f} mm {} its fossa: not MI, not one frame, or "
                                "normals inside out?",
                                std::abs(in_mi_mm), in_mi_mm < 0.0 ? "inside" : "from"));
  }
  return {};
}

}  // namespace

Status add_joints(const Joints& joints, const fs::path& where, RealizabilityChecker* checker,
                  std::vector<std::string>* notes) {
  checker->use_joints(joints);
  GNATHION_CHECK_OK(plausible_joints(*checker, joints, where));
  notes->insert(notes->end(), joints.warnings.begin(), joints.warnings.end());
  if (!joints.left || !joints.right)
    notes->push_back(fmt::format("only the {} joint is known", joints.left ? "left" : "right"));
  return {};
}

Status add_knowledge(const KnowledgeFiles& files, const TriangleMesh& maxilla,
                     const TriangleMesh& mandible_mi, RealizabilityChecker* checker,
                     std::vector<std::string>* notes, Progress& progress) {
  if (!files.cbct.empty()) {
    NestedProgress finding(progress, "finding the joints", 0.4);
    GNATHION_TRY(const CbctOptions options, cbct_options_of(files));
    GNATHION_TRY(const Joints joints, joints_from_cbct(files.cbct, maxilla, mandible_mi, options, finding));
    GNATHION_CHECK_OK(add_joints(joints, files.cbct, checker, notes));
  }
  if (files.motion.empty()) return {};
  GNATHION_TRY(const JawMotion motion, read_dental_motion(files.motion, files.calibration));
  const std::vector<Rigid3> motions = valid_motions(motion);
  checker->use_recording(motions);
  const double reach = reach_of(motions, checker->arch().incisal_mm);
  if (reach < kShortReachMm)
    notes->push_back(
        fmt::format("the recording takes the incisal point only {:.1f} mm from MI: its envelope is not "
                    "that of what the jaw can do",
                    reach));
  return {};
}

Result<Patient> read_patient(const PatientFiles& files, const RealizabilityLimits& limits,
                             Progress& progress) {
  progress.begin_step("reading the jaws", 0.2);
  GNATHION_TRY(TriangleMesh maxilla, read_jaw(files.maxilla));
  GNATHION_TRY(TriangleMesh mandible, read_jaw(files.mandible));
  progress.begin_step("teeth, contacts, overlap in MI", 0.3);
  GNATHION_TRY(RealizabilityChecker checker, RealizabilityChecker::create(maxilla, mandible, limits));
  Patient patient{std::move(maxilla), std::move(mandible), std::move(checker), {}, {}};
  GNATHION_CHECK_OK(
      add_knowledge(files, patient.maxilla, patient.mandible_mi, &patient.checker, &patient.notes, progress));
  if (!files.motion.empty()) {
    GNATHION_TRY(patient.motion, read_dental_motion(files.motion, files.calibration));
  }
  return patient;
}

Result<CheckOutcome> run_check(const PatientFiles& files, const fs::path& transform, Progress& progress) {
  GNATHION_TRY(const MotionFile motion, read_motion(transform));
  GNATHION_TRY(const Patient patient, read_patient(files, {}, progress));
  progress.begin_step("checking", 0.1);
  CheckOutcome out;
  out.feasibility = patient.checker.check(motion.motion, motion.covariance);
  out.feasibility.notes = patient.notes;
  if (!motion.covariance)
    out.feasibility.notes.push_back("T_th has no covariance: how sure the verdict is cannot be told");
  out.text = feasibility_text(out.feasibility);
  return out;
}

std::string feasibility_text(const Feasibility& f) {
  std::string text = fmt::format("{}\n", verdict_name(f.verdict));
  for (const Constraint& c : f.constraints) {
    if (c.pass && c.name != "recorded_envelope" && c.name != "condyle_fossa") continue;
    if (!c.checked) {
      text += fmt::format("  {}: {}\n", c.name, c.consequence);
      continue;
    }
    const std::string sure = c.sigma ? fmt::format(" (sigma {:.3f})", *c.sigma) : "";
    text += fmt::format("  {}: {:.3f} {}{}, limit {:.3f}: {}\n", c.name, c.value, c.unit, sure, c.limit,
                        c.consequence);
  }
  for (const std::string& note : f.notes) text += "  note: " + note + "\n";
  return text;
}

}  // namespace gnathion
