// Mesh distances on a coarse grid: exact near the surface, swept beyond.
#pragma once

#include "core/mesh_query.h"
#include "design/coarse_grid.h"

namespace gnathion {

/// Which end of every column is outside of the solid.
enum class OutsideEnd { kBottom, kTop };

/// Signed distance from each node x to the solid, told at `mesh_from_design` · x; clamped to ± band_mm. Exact
/// within 2.5 spacings of the surface; from there the Eikonal equation is swept on (to a few hundredths),
/// which costs a fraction of the searches. Far nodes take the side of their neighbour in the column, counted
/// from the outside end.
CoarseGrid sampled_distance(const GridShape& shape, const MeshQuery& solid, const Rigid3& mesh_from_design,
                            double band_mm, OutsideEnd outside);

}  // namespace gnathion
