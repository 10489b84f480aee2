// Mesh distances on a coarse grid: exact near the surface, swept beyond.
#pragma once

#include "core/mesh_query.h"
#include "design/coarse_grid.h"

namespace gnathion {

/// Which end of every column is outside of the solid.
enum class OutsideEnd { kBottom, kTop };

/// Signed distance from each node x to the solid, told at `mesh_from_design` · x; clamped to ± band_mm.
/// Searched within 1.2 spacings of the surface; up to 2.5 the distance to the nearest of the triangles that
/// the neighbours found; from there the Eikonal equation is swept on (to a few hundredths). Each step costs a
/// fraction of the one before. Far nodes take the side of their neighbour in the column, counted
/// from the outside end.
CoarseGrid sampled_distance(const GridShape& shape, const MeshQuery& solid, const Rigid3& mesh_from_design,
                            double band_mm, OutsideEnd outside);

}  // namespace gnathion
