#include "anatomy/realizability.h"

#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "anatomy/constraints.h"
#include "occlusion/contacts.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

Verdict verdict_of(const std::vector<Constraint>& constraints) {
  Verdict verdict = Verdict::kRealizable;
  for (const auto& c : constraints) {
    if (c.pass) continue;
    if (c.severity == Severity::kBlocks) return Verdict::kNotRealizable;
    if (c.severity == Severity::kApertures) verdict = Verdict::kRealizableWithApertures;
  }
  return verdict;
}

void add_sigmas(const std::optional<Matrix6>& covariance, std::vector<Constraint>* constraints) {
  if (!covariance) return;
  for (auto& c : *constraints)
    if (c.checked && !c.sigma && !c.gradient.isZero())
      c.sigma = std::sqrt(std::max(0.0, c.gradient.dot(*covariance * c.gradient)));
}

}  // namespace

const char* verdict_name(Verdict verdict) {
  switch (verdict) {
    case Verdict::kRealizable:
      return "realizable";
    case Verdict::kRealizableWithApertures:
      return "realizable_with_apertures";
    case Verdict::kNotRealizable:
      break;
  }
  return "not_realizable";
}

std::optional<double> Constraint::confidence() const {
  if (!sigma || !checked) return std::nullopt;
  const double away = (pass ? 1.0 : -1.0) * (value - limit) * (at_least ? 1.0 : -1.0);
  if (*sigma <= 0.0) return away >= 0.0 ? 1.0 : 0.0;
  return 0.5 * std::erfc(-away / (*sigma * std::sqrt(2.0)));
}

std::vector<std::string> Feasibility::violated() const {
  std::vector<std::string> names;
  for (const auto& c : constraints)
    if (!c.pass && c.severity != Severity::kInforms) names.push_back(c.name);
  return names;
}

struct RealizabilityChecker::Jaws {
  RealizabilityLimits limits;
  std::vector<LimitRow> table;
  ArchFrame arch;
  std::vector<std::uint8_t> maxilla_fdi, mandible_fdi;
  MeshQuery maxilla, mandible;
  Overlap overlap_mi;
  std::vector<ToothOverlap> tooth_overlap_mi;
  std::vector<StampSample> stamp;
  JointPair joints;
  std::optional<MotionEnvelope> envelope;
};

RealizabilityChecker::RealizabilityChecker(std::unique_ptr<Jaws> jaws) : jaws_(std::move(jaws)) {}
RealizabilityChecker::~RealizabilityChecker() = default;
RealizabilityChecker::RealizabilityChecker(RealizabilityChecker&&) noexcept = default;
RealizabilityChecker& RealizabilityChecker::operator=(RealizabilityChecker&&) noexcept = default;
const ArchFrame& RealizabilityChecker::arch() const {
  return jaws_->arch;
}
const RealizabilityLimits& RealizabilityChecker::limits() const {
  return jaws_->limits;
}
const JointPair& RealizabilityChecker::joints() const {
  return jaws_->joints;
}

Result<RealizabilityChecker> RealizabilityChecker::create(const TriangleMesh& maxilla,
                                                          const TriangleMesh& mandible_mi,
                                                          const RealizabilityLimits& limits) {
  GNATHION_TRY(const NamedJaws named, name_jaws(maxilla, mandible_mi));
  return create(maxilla, mandible_mi, named, limits);
}

RealizabilityChecker RealizabilityChecker::create(const TriangleMesh& maxilla,
                                                  const TriangleMesh& mandible_mi, const NamedJaws& named,
                                                  const RealizabilityLimits& limits) {
  const ArchFrame& arch = named.arch;
  std::optional<MeshQuery> upper, lower;
  tbb::parallel_invoke([&] { upper.emplace(maxilla); }, [&] { lower.emplace(mandible_mi); });
  auto jaws = std::make_unique<Jaws>(Jaws{.limits = limits,
                                          .table = limit_table(limits),
                                          .arch = arch,
                                          .maxilla_fdi = named.maxilla.fdi,
                                          .mandible_fdi = named.mandible.fdi,
                                          .maxilla = std::move(*upper),
                                          .mandible = std::move(*lower),
                                          .overlap_mi = {},
                                          .tooth_overlap_mi = {},
                                          .stamp = {},
                                          .joints = {},
                                          .envelope = {}});
  const Rigid3 mi;
  jaws->overlap_mi = find_overlap(jaws->maxilla, jaws->mandible, mi, arch.up);
  if (jaws->overlap_mi.depth_mm > 0.0)
    jaws->tooth_overlap_mi = tooth_overlaps(jaws->maxilla, jaws->mandible, jaws->mandible_fdi, arch, mi);
  jaws->stamp = stamp_samples(jaws->maxilla, mandible_mi, jaws->mandible_fdi, arch);
  return RealizabilityChecker(std::move(jaws));
}

void RealizabilityChecker::use_joints(const Joints& joints) {
  jaws_->joints = ready_joints(joints, jaws_->arch.up);
}

void RealizabilityChecker::use_recording(const std::vector<Rigid3>& motions) {
  jaws_->envelope.emplace(motions, jaws_->arch, condyle_mm(Side::kLeft), condyle_mm(Side::kRight));
}

Vector3 mean_condyle_mm(const ArchFrame& arch, Side side, const RealizabilityLimits& l) {
  const double sideways = side == Side::kLeft ? l.condyle_half_distance_mm : -l.condyle_half_distance_mm;
  return arch.incisal_mm - l.condyle_behind_mm * arch.anterior + l.condyle_above_mm * arch.up +
         sideways * arch.left;
}

Vector3 RealizabilityChecker::condyle_mm(Side side) const {
  const auto& known = side == Side::kLeft ? jaws_->joints.left : jaws_->joints.right;
  if (known) return known->joint().centre_mm();
  return mean_condyle_mm(jaws_->arch, side, jaws_->limits);
}

Feasibility RealizabilityChecker::check(const Motion<Dental>& therapeutic,
                                        const std::optional<Matrix6>& covariance, bool with_support) const {
  const Jaws& j = *jaws_;
  const Rigid3& motion = therapeutic.rigid;
  JawsInTp jaws{.maxilla = j.maxilla,
                .mandible = j.mandible,
                .maxilla_fdi = j.maxilla_fdi,
                .mandible_fdi = j.mandible_fdi,
                .arch = j.arch,
                .limits = j.limits,
                .table = j.table,
                .overlap_mi = j.overlap_mi,
                .tooth_overlap_mi = j.tooth_overlap_mi,
                .stamp = j.stamp,
                .joints = j.joints,
                .envelope = j.envelope ? &*j.envelope : nullptr,
                .condyle_left_mm = condyle_mm(Side::kLeft),
                .condyle_right_mm = condyle_mm(Side::kRight),
                .therapeutic = motion,
                .overlap_tp = find_overlap(j.maxilla, j.mandible, motion, j.arch.up),
                .tooth_overlap_tp = {},
                .clearances = tooth_clearances(j.maxilla, j.maxilla_fdi, j.mandible.mesh(), j.mandible_fdi,
                                               motion, j.arch)};
  if (jaws.overlap_tp.depth_mm > 0.0)
    jaws.tooth_overlap_tp = tooth_overlaps(j.maxilla, j.mandible, j.mandible_fdi, j.arch, motion);

  Feasibility out;
  out.arch = j.arch;
  out.joints = joint_reports(jaws, covariance);
  out.constraints = {mandible_below_maxilla(jaws), no_intersection(jaws), interocclusal_clearance(jaws),
                     wall_room(jaws)};
  for (auto& c : reachable_from_mi(jaws)) out.constraints.push_back(std::move(c));
  if (jaws.envelope) out.constraints.push_back(recorded_envelope(jaws));
  if (with_support) {
    const Support support = support_in_tp(jaws);
    out.constraints.push_back(uniform_contact(jaws, support));
    out.constraints.push_back(support_polygon(jaws, support));
    out.support = support.report;
  }
  for (auto& c : joint_constraints(jaws, out.joints)) out.constraints.push_back(std::move(c));
  add_sigmas(covariance, &out.constraints);
  out.verdict = verdict_of(out.constraints);
  out.teeth = tooth_rooms(jaws);
  out.overlap = {jaws.overlap_tp.depth_mm, jaws.overlap_tp.volume_mm3, j.overlap_mi.depth_mm,
                 j.overlap_mi.volume_mm3};
  out.joints_source = out.joints.empty() ? "joints not checked: no CBCT" : j.joints.known.source;
  return out;
}

Result<Feasibility> check_realizability(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                                        const Motion<Dental>& therapeutic,
                                        const RealizabilityLimits& limits) {
  GNATHION_TRY(const RealizabilityChecker checker,
               RealizabilityChecker::create(maxilla, mandible_mi, limits));
  return checker.check(therapeutic);
}

}  // namespace gnathion
