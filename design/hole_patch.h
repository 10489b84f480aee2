// A scan hole filled as the surface about it goes on.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

constexpr double kUnsureHoleMm = 1.3;  // wider holes are filled on the safe side

/// Fills the loop (of boundary vertices, oriented so that a triangle (v0, v1, new) fits its neighbours) with
/// rings of vertices on the quadric that fits the surface about it: a cusp keeps its top. Holes wider than
/// 1.3 mm, where the surface may do anything, get a tenth of their width more, but no more than the tangent
/// planes at the rim allow: what is built over them never protrudes into the tooth. False, and nothing done,
/// where the loop is no plain hole: not star-shaped, folded, or without enough surface about it.
bool fill_with_patch(TriangleMesh& mesh, const std::vector<Vector3>& normals,
                     const std::vector<std::uint32_t>& loop);

}  // namespace gnathion
