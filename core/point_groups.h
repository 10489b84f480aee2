// Points sorted by place, for work that is cheaper on neighbours together.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

/// Points by the cells of a cubic grid, cells in Morton order, points of a cell by index. The same for the
/// same points on any number of threads.
struct PointGroups {
  std::vector<std::uint32_t> points;
  std::vector<std::size_t> starts;  ///< of each group in `points`, and the end
  std::size_t size() const { return starts.size() - 1; }
  const std::uint32_t* begin(std::size_t group) const { return points.data() + starts[group]; }
  const std::uint32_t* end(std::size_t group) const { return points.data() + starts[group + 1]; }
};
/// Points that are not finite go into the first cell.
PointGroups grouped_by_place(const std::vector<Vector3>& points_mm, double side_mm);

/// A side of the cells that makes LocalQuery pay: some tens of points where a surface passes a cell, and few
/// triangles.
double group_side_mm(const std::vector<Vector3>& points_mm, const TriangleMesh& mesh);

/// The ball about the points of a group.
struct GroupBall {
  Vector3 centre_mm = Vector3::Zero();
  double radius_mm = 0.0;
};
GroupBall ball_about(const std::vector<Vector3>& points_mm, const std::uint32_t* begin,
                     const std::uint32_t* end);

}  // namespace gnathion
