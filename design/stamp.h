// The digital stamp: the occlusal surface of the arch that wears the splint, carried to TP, and the body
// between it and the shell.
#pragma once

#include "design/coarse_grid.h"
#include "design/preparation.h"

namespace gnathion {

/// The crowns' tops of M carried to TP (down to stamp_height from the local occlusal level), or all of a
/// given S_occ, filled towards the gingiva with drafted side walls, under the shell never to less than its
/// own outline 1 mm inwards. `stamp` is the distance to the carried solid.
CoarseGrid stamp_body(const CoarseGrid& stamp, const CoarseGrid& shell, const Preparation& preparation,
                      const SplintParameters& p);

/// Shell and stamp joined: concave corners on the sides get fillets, so that no shelf catches cheek or
/// tongue; towards the opposing arch the joint rises no more than the imprint depth over the stamp.
/// `opposing` is the distance to L_TP.
CoarseGrid joined_body(const CoarseGrid& shell, const CoarseGrid& stamp, const CoarseGrid& opposing,
                       const SplintParameters& p);

}  // namespace gnathion
