// How deep points run into a solid on a straight way: what insertion and opening ask.
#pragma once

#include <vector>

#include "core/mesh_query.h"

namespace gnathion {

struct SweptDepth {
  double depth_mm = 0.0;
  double way_mm = 0.0;                 ///< along the way, where that is
  Vector3 start_mm = Vector3::Zero();  ///< of the point that runs deepest
};

/// Deepest place of any point p + s·direction, 0 <= s <= length_mm, in the closed solid. `direction` is unit.
/// The ways' chords through the solid are exact (rays); along a chord the depth is sampled every 0.1 mm (at
/// most 40 samples), so that it may be told short by what a surface bends within that. Deterministic.
SweptDepth deepest_on_way(const std::vector<Vector3>& points_mm, const Vector3& direction, double length_mm,
                          const MeshQuery& solid);

/// The same for each point by itself, where that is deeper than `past_mm`; a depth of 0 elsewhere.
std::vector<SweptDepth> depths_on_way(const std::vector<Vector3>& points_mm, const Vector3& direction,
                                      double length_mm, const MeshQuery& solid, double past_mm);

}  // namespace gnathion
