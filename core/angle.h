// Degrees for people and files, radians for everything else.
#pragma once

#include <numbers>

namespace gnathion {

inline constexpr double kRadPerDeg = std::numbers::pi / 180.0;
inline constexpr double kDegPerRad = 180.0 / std::numbers::pi;

}  // namespace gnathion
