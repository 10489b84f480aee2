// The digital stamp: the maxilla's occlusal surface carried to TP, and the body between it and the shell.
#pragma once

#include "design/coarse_grid.h"
#include "design/preparation.h"

namespace gnathion {

/// The crowns' tops of T_th·M (down to stamp_height from the local occlusal level), filled towards the
/// gingiva with drafted side walls. `stamp` is the distance to T_th·M.
CoarseGrid stamp_body(const CoarseGrid& stamp, const Preparation& preparation, const SplintParameters& p);

/// Shell and stamp joined: concave corners on the sides get fillets, so that no shelf catches cheek or
/// tongue; towards the mandible the joint rises no more than the imprint depth over the stamp. `mandible` is
/// the distance to L_TP.
CoarseGrid joined_body(const CoarseGrid& shell, const CoarseGrid& stamp, const CoarseGrid& mandible,
                       const SplintParameters& p);

}  // namespace gnathion
