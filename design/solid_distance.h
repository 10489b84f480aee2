// Signed distance to a scan closed to a solid.
#pragma once

#include <optional>

#include "core/mesh_query.h"

namespace gnathion {

/// As MeshQuery::signed_distance; but where the closest feature's normal is nearly across the way to it, as
/// beside folded slivers of a scan, three rays vote on the side.
std::optional<SignedDistance> solid_distance(const MeshQuery& solid, const Vector3& p_mm,
                                             double max_distance_mm);

}  // namespace gnathion
