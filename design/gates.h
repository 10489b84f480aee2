// The bars that decide the verdict.
#pragma once

#include "design/flat_plane.h"
#include "design/verification.h"

namespace gnathion {

std::vector<Gate> splint_gates(const SplintVerification& v, const SplintParameters& p,
                               double side_wall_p01_mm);

constexpr double kFlatTipToleranceMm = 0.05;
/// How deep any opposing tooth, incisors too, stands in a flat plane: a well there holds it.
Gate flat_tip_gate(const FlatPlane& plane, const SplintParameters& p);

}  // namespace gnathion
