// The single constraints of realizability, one function each.
#pragma once

#include <vector>

#include "anatomy/realizability.h"
#include "core/mesh_query.h"
#include "occlusion/contacts.h"

namespace gnathion {

/// Everything the constraints look at, computed once per transformation.
struct JawsInTp {
  const MeshQuery& maxilla;
  const MeshQuery& mandible;  ///< in MI
  const std::vector<std::uint8_t>& maxilla_fdi;
  const std::vector<std::uint8_t>& mandible_fdi;
  const ArchFrame& arch;
  const Overlap& overlap_mi;
  const Contacts& contacts_mi;  ///< on the mandible
  Rigid3 therapeutic;
  Overlap overlap_tp;
  std::vector<ToothClearance> clearances;  ///< in TP, per mandibular tooth
};

Constraint mandible_below_maxilla(const JawsInTp& jaws);
Constraint no_intersection(const JawsInTp& jaws, const RealizabilityLimits& limits);
Constraint interocclusal_clearance(const JawsInTp& jaws, const RealizabilityLimits& limits);
Constraint wall_room(const JawsInTp& jaws, const RealizabilityLimits& limits);
/// Rotations, displacements of the incisal point and of the estimated condyles.
std::vector<Constraint> reachable_from_mi(const ArchFrame& arch, const Rigid3& therapeutic,
                                          const RealizabilityLimits& limits);
Constraint uniform_contact(const JawsInTp& jaws, const RealizabilityLimits& limits);
Constraint joints_not_checked();

}  // namespace gnathion
