// The order of points along Hilbert's space-filling curve: neighbours on it are neighbours in space.
#pragma once

#include <cstdint>
#include <vector>

#include "core/rigid.h"

namespace gnathion {

/// Indices of the points in the order of the curve through their bounding box (10 bits an axis); equal codes
/// in the order of the points. Points that are not finite come last.
std::vector<std::uint32_t> hilbert_order(const std::vector<Vector3>& points_mm);

}  // namespace gnathion
