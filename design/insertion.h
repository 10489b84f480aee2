// The seating direction a: along which the splint goes on with the least undercut to block out.
#pragma once

#include "design/coarse_grid.h"
#include "design/parameters.h"
#include "design/preparation.h"

namespace gnathion {

/// A solid by its columns: whether each node lies inside. Lines along z are counted through the surface, so
/// that no search tree is needed; surfaces that fold over themselves count once.
std::vector<char> nodes_inside(const TriangleMesh& solid, const GridShape& shape);

/// The direction within `insertion_search_deg` of the start (z, tilted as the parameters say) that leaves the
/// least undercut volume on the crowns down to the cutting surface: the volume of ((M ⊕ R_a) \ M). A tilt
/// must pay: 2 % of the volume for the widest one. `support` is M, closed, in a frame whose z is the occlusal
/// normal towards its gingiva, `level` its occlusal level there, and `upright_from_dental` leads there; the
/// direction is told in that frame. Margin curves (Dental) cut the crowns as they will the splint.
/// Deterministic.
Insertion find_insertion(const TriangleMesh& support, const OcclusalMap& level, Arch arch,
                         const SplintParameters& p, const std::vector<MarginCurve>& margins,
                         const Rigid3& upright_from_dental);

}  // namespace gnathion
