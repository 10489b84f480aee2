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

Result<Feasibility> check_realizability(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                                        const Motion<Dental>& therapeutic,
                                        const RealizabilityLimits& limits) {
  Feasibility out;
  GNATHION_TRY(out.arch, find_arch(maxilla, mandible_mi));
  const auto maxilla_fdi = assign_teeth(maxilla, out.arch, Arch::kMaxilla);
  const auto mandible_fdi = assign_teeth(mandible_mi, out.arch, Arch::kMandible);
  const MeshQuery upper(maxilla), lower(mandible_mi);
  const Rigid3& motion = therapeutic.rigid;
  const JawsInTp jaws{
      .maxilla = upper,
      .mandible = lower,
      .maxilla_fdi = maxilla_fdi,
      .mandible_fdi = mandible_fdi,
      .arch = out.arch,
      .therapeutic = motion,
      .overlap_mi = find_overlap(upper, lower, Rigid3::identity(), out.arch.up),
      .overlap_tp = find_overlap(upper, lower, motion, out.arch.up),
      .clearances = tooth_clearances(upper, maxilla_fdi, mandible_mi, mandible_fdi, motion, out.arch)};

  out.constraints.push_back(mandible_below_maxilla(jaws));
  out.constraints.push_back(no_intersection(jaws, limits));
  out.constraints.push_back(interocclusal_clearance(jaws, limits));
  out.constraints.push_back(wall_room(jaws, limits));
  for (auto& c : reachable_from_mi(out.arch, motion, limits)) out.constraints.push_back(std::move(c));
  out.constraints.push_back(uniform_contact(jaws, limits));
  out.constraints.push_back(joints_not_checked());
  out.verdict = verdict_of(out.constraints);
  return out;
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
