// The outer shell: the cavity's offset by the wall, swept along a so that it never has undercuts of its own.
#pragma once

#include "design/coarse_grid.h"
#include "design/parameters.h"

namespace gnathion {

/// Shell around M ⊕ R_a: w beyond the cavity at the walls, the occlusal thickness under biting surfaces.
CoarseGrid outer_shell(const CoarseGrid& maxilla_swept, const SplintParameters& p);

}  // namespace gnathion
