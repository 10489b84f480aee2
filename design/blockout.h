// Insertion: what of the neighbourhood of the arch that wears the splint must stay free for the splint to
// pass and to seat.
#pragma once

#include "design/coarse_grid.h"
#include "design/parameters.h"

namespace gnathion {

/// Cavity = (M ⊕ B_g) ∪ ((M ⊕ R_a) ⊖ D_r) on the coarse grid; both arguments are distances.
CoarseGrid coarse_cavity(const CoarseGrid& support, const CoarseGrid& support_swept,
                         const SplintParameters& p);

/// The cavity with grooves narrower than twice the embrasure radius closed, so that no fin of the splint
/// stands between two teeth. Grown by less than the grid's own error nowhere else.
CoarseGrid without_embrasures(const CoarseGrid& cavity, const SplintParameters& p);

}  // namespace gnathion
