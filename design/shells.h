// The outer shell: the cavity's offset by the wall, swept along a so that it never has undercuts of its own.
#pragma once

#include "design/coarse_grid.h"
#include "design/parameters.h"
#include "design/preparation.h"

namespace gnathion {

/// Distance across a from the cavity's outline at the cutting surface (the same in every layer): where a
/// tooth slopes, the shell's rim ends there instead of running out into a thin lip.
CoarseGrid distance_from_rim_outline(const CoarseGrid& support_swept, const Preparation& preparation,
                                     const SplintParameters& p);

/// Shell around M ⊕ R_a: w beyond the cavity at the walls, the occlusal thickness under biting surfaces.
/// No wider at the rim than the wall and a little.
CoarseGrid outer_shell(const CoarseGrid& support_swept, const CoarseGrid& outline_distance,
                       const SplintParameters& p);

}  // namespace gnathion
