// Whether two triangles have points in common, exactly.
//
// Triangles are closed: touching counts. Corners at the same place are one vertex. What is asked depends on
// how many vertices the two have in common:
//   none   any common point;
//   one    a common point besides that vertex;
//   two    a common point besides that edge: they lie in one plane, folded over each other;
//   three  always: the same triangle twice.
// Triangles without area are no surface and never meet anything.
#pragma once

#include <array>
#include <cstdint>

#include "core/mesh.h"

namespace gnathion {

/// True if the corners are exactly in one line.
bool is_degenerate(const Vector3& a, const Vector3& b, const Vector3& c);

/// The triangles p and q, none degenerate, whose corners carry ids that are equal where corners are shared.
/// Ids of all different value ask for any common point.
bool triangles_intersect(const std::array<Vector3, 3>& p, const Triangle& p_ids,
                         const std::array<Vector3, 3>& q, const Triangle& q_ids);

}  // namespace gnathion
