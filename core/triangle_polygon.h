// Polygons into triangles.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/rigid.h"

namespace gnathion {

/// Cuts a simple polygon in space, convex or not, into n − 2 triangles of corner numbers, wound as the
/// polygon is: from its first corner where it is convex, else by cutting off ears (Meisters 1975) as seen
/// along its normal (Newell's). What is no simple polygon there, or has more than 512 corners, is cut as if
/// convex.
std::vector<std::array<std::uint32_t, 3>> triangulated_polygon(const std::vector<Vector3>& corners_mm);

}  // namespace gnathion
