// Freedom of movement: where the opposing arch passes on its excursions from TP, so that they run free.
#pragma once

#include <vector>

#include "core/mesh_query.h"
#include "design/coarse_grid.h"
#include "design/parameters.h"
#include "design/splint.h"

namespace gnathion {

/// One place of the opposing arch on an excursion.
struct FreePose {
  Rigid3 from_tp;     ///< from its place in TP, design frame
  double away = 0.0;  ///< 0 at TP to 1 from two millimetres of way on: how much of the disclusion is asked
};

/// Excursions from TP: the recorded ones, or straight ones at the given angles where none are given and
/// `excursion_mm` asks for them; empty: none.
///
/// A recorded displacement R of the mandible from MI is told anew from TP, as T_th·R: what the patient's
/// joints and teeth allowed about MI is allowed about TP, where the condyles are the centres as before.
/// Rests, and places that others already stand for (within 0.25 mm on the arch), are left out, and so is what
/// is too far open to meet a splint. The disclusion grows with the way over the first two millimetres.
std::vector<FreePose> free_poses(const SplintInputs& inputs, const ArchFrame& arch,
                                 const Rigid3& design_from_dental, const SplintParameters& p);

/// Least distance to the opposing arch (in TP, design frame) over all poses, less their share of the
/// disclusion and of the grid's own error (a third of its spacing), at the nodes with `body` below 1 mm; far
/// outside of them.
CoarseGrid swept_along(const std::vector<FreePose>& poses, double disclusion_mm, const MeshQuery& opposing,
                       const CoarseGrid& body);

}  // namespace gnathion
