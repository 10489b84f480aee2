// The bars that decide the verdict.
#pragma once

#include "design/verification.h"

namespace gnathion {

std::vector<Gate> splint_gates(const SplintVerification& v, const SplintParameters& p,
                               double side_wall_p01_mm);

}  // namespace gnathion
