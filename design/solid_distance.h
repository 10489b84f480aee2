// Signed distance to a scan closed to a solid.
#pragma once

#include <optional>

#include "core/mesh_query.h"

namespace gnathion {

/// As MeshQuery::signed_distance; but scans fold back over themselves at crests and in fissures, where the
/// closest normal misleads: off the surface, a ray must agree with it, or the majority of three rays decides.
std::optional<SignedDistance> solid_distance(const MeshQuery& solid, const Vector3& p_mm,
                                             double max_distance_mm);

}  // namespace gnathion
