#include "anatomy/realizability.h"

#include <nlohmann/json.hpp>

#include "anatomy/constraints.h"
#include "core/mesh_query.h"
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

nlohmann::json constraint_json(const Constraint& c) {
  nlohmann::json j;
  j["name"] = c.name;
  j["value"] = c.checked ? nlohmann::json(c.value) : nlohmann::json(nullptr);
  j["limit"] = c.checked ? nlohmann::json(c.limit) : nlohmann::json(nullptr);
  j["unit"] = c.unit;
  j["pass"] = c.pass;
  j["where_mm"] = {c.where_mm.x(), c.where_mm.y(), c.where_mm.z()};
  j["teeth"] = nlohmann::json::array();
  for (const auto fdi : c.teeth) j["teeth"].push_back(static_cast<int>(fdi));
  j["consequence"] = c.consequence;
  return j;
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

std::vector<std::string> Feasibility::violated() const {
  std::vector<std::string> names;
  for (const auto& c : constraints)
    if (!c.pass && c.severity != Severity::kInforms) names.push_back(c.name);
  return names;
}

struct RealizabilityChecker::Jaws {
  RealizabilityLimits limits;
  ArchFrame arch;
  std::vector<std::uint8_t> maxilla_fdi, mandible_fdi;
  MeshQuery maxilla, mandible;
  Overlap overlap_mi;
  Contacts contacts_mi;
};

RealizabilityChecker::RealizabilityChecker(std::unique_ptr<Jaws> jaws) : jaws_(std::move(jaws)) {}
RealizabilityChecker::~RealizabilityChecker() = default;
RealizabilityChecker::RealizabilityChecker(RealizabilityChecker&&) noexcept = default;
RealizabilityChecker& RealizabilityChecker::operator=(RealizabilityChecker&&) noexcept = default;
const ArchFrame& RealizabilityChecker::arch() const {
  return jaws_->arch;
}

Result<RealizabilityChecker> RealizabilityChecker::create(const TriangleMesh& maxilla,
                                                          const TriangleMesh& mandible_mi,
                                                          const RealizabilityLimits& limits) {
  GNATHION_TRY(const ArchFrame arch, find_arch(maxilla, mandible_mi));
  auto jaws = std::make_unique<Jaws>(Jaws{.limits = limits,
                                          .arch = arch,
                                          .maxilla_fdi = assign_teeth(maxilla, arch, Arch::kMaxilla),
                                          .mandible_fdi = assign_teeth(mandible_mi, arch, Arch::kMandible),
                                          .maxilla = MeshQuery(maxilla),
                                          .mandible = MeshQuery(mandible_mi),
                                          .overlap_mi = {},
                                          .contacts_mi = {}});
  jaws->overlap_mi = find_overlap(jaws->maxilla, jaws->mandible, Rigid3::identity(), arch.up);
  jaws->contacts_mi = find_contacts(mandible_mi, jaws->mandible_fdi, Rigid3::identity(), jaws->maxilla,
                                    -arch.up, arch, limits.contact_mm);
  return RealizabilityChecker(std::move(jaws));
}

Feasibility RealizabilityChecker::check(const Motion<Dental>& therapeutic) const {
  const Rigid3& motion = therapeutic.rigid;
  const JawsInTp jaws{
      .maxilla = jaws_->maxilla,
      .mandible = jaws_->mandible,
      .maxilla_fdi = jaws_->maxilla_fdi,
      .mandible_fdi = jaws_->mandible_fdi,
      .arch = jaws_->arch,
      .overlap_mi = jaws_->overlap_mi,
      .contacts_mi = jaws_->contacts_mi,
      .therapeutic = motion,
      .overlap_tp = find_overlap(jaws_->maxilla, jaws_->mandible, motion, jaws_->arch.up),
      .clearances = tooth_clearances(jaws_->maxilla, jaws_->maxilla_fdi, jaws_->mandible.mesh(),
                                     jaws_->mandible_fdi, motion, jaws_->arch)};
  Feasibility out;
  out.arch = jaws_->arch;
  out.constraints = {mandible_below_maxilla(jaws), no_intersection(jaws, jaws_->limits),
                     interocclusal_clearance(jaws, jaws_->limits), wall_room(jaws, jaws_->limits)};
  for (auto& c : reachable_from_mi(jaws_->arch, motion, jaws_->limits))
    out.constraints.push_back(std::move(c));
  out.constraints.push_back(uniform_contact(jaws, jaws_->limits));
  out.constraints.push_back(joints_not_checked());
  out.verdict = verdict_of(out.constraints);
  return out;
}

Result<Feasibility> check_realizability(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                                        const Motion<Dental>& therapeutic,
                                        const RealizabilityLimits& limits) {
  GNATHION_TRY(const RealizabilityChecker checker,
               RealizabilityChecker::create(maxilla, mandible_mi, limits));
  return checker.check(therapeutic);
}

nlohmann::json feasibility_json(const Feasibility& feasibility) {
  nlohmann::json j;
  j["verdict"] = verdict_name(feasibility.verdict);
  j["violated"] = feasibility.violated();
  j["constraints"] = nlohmann::json::array();
  for (const auto& c : feasibility.constraints) j["constraints"].push_back(constraint_json(c));
  return j;
}

}  // namespace gnathion
