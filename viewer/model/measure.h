// What a click measures, in 3D and in the cross-section.
#pragma once

#include <cstddef>

namespace gnathion {

enum class Measure { kDistance, kAngle, kThickness };
/// Clicks that make one measurement; of a wall the second point is found.
inline constexpr std::size_t clicks_of(Measure what) {
  return what == Measure::kDistance ? 2 : what == Measure::kAngle ? 3 : 1;
}
inline constexpr double kThickestMm = 15.0;  ///< a wall behind that is another one

}  // namespace gnathion
