// The tops of the crowns: what the arch curve is drawn through.
#pragma once

#include <optional>
#include <vector>

#include "occlusion/arch.h"

namespace gnathion {

/// Vertices near the plane through origin_mm that look at the opposing arch: cusps, fossae, incisal edges.
/// Walls, palate and base stay out.
std::vector<Vector3> crown_tops(const TriangleMesh& arch_mesh, const Vector3& origin_mm, const Vector3& up,
                                Arch which);

/// Arch curve through points told in (left, posterior), right end to left end; see horseshoe.h.
std::optional<std::vector<Eigen::Vector2d>> curve_through(const std::vector<Eigen::Vector2d>& points_mm);

}  // namespace gnathion
