#include "core/point_groups.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

constexpr double kPointsPerGroup = 32;
constexpr double kTrianglesPerSide = 1.5;

struct Placed {
  std::uint64_t cell;
  std::uint32_t point;
  bool operator<(const Placed& b) const { return cell != b.cell ? cell < b.cell : point < b.point; }
};

/// Spreads the low 21 bits so that two zeros follow each.
std::uint64_t spread(std::uint64_t x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x1f00000000ffffULL;
  x = (x | x << 16) & 0x1f0000ff0000ffULL;
  x = (x | x << 8) & 0x100f00f00f00f00fULL;
  x = (x | x << 4) & 0x10c30c30c30c30c3ULL;
  return (x | x << 2) & 0x1249249249249249ULL;
}

Box box_of(const std::vector<Vector3>& points) {
  Box box;
  for (const Vector3& p : points)
    if (p.allFinite()) box.extend(p);
  return box;
}

}  // namespace

PointGroups grouped_by_place(const std::vector<Vector3>& points, double side_mm) {
  PointGroups groups;
  const Box box = box_of(points);
  const double side = std::max(side_mm, box.size_mm().maxCoeff() / static_cast<double>(1 << 20));
  std::vector<Placed> placed(points.size());
  tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    const Vector3 at =
        points[i].allFinite() ? Vector3((points[i] - box.min_mm) / side) : Vector3(Vector3::Zero());
    placed[i] = {spread(static_cast<std::uint64_t>(at.x())) |
                     spread(static_cast<std::uint64_t>(at.y())) << 1 |
                     spread(static_cast<std::uint64_t>(at.z())) << 2,
                 static_cast<std::uint32_t>(i)};
  });
  tbb::parallel_sort(placed.begin(), placed.end());
  groups.points.resize(placed.size());
  for (std::size_t i = 0; i < placed.size(); ++i) {
    if (i == 0 || placed[i].cell != placed[i - 1].cell) groups.starts.push_back(i);
    groups.points[i] = placed[i].point;
  }
  groups.starts.push_back(placed.size());
  return groups;
}

double group_side_mm(const std::vector<Vector3>& points, const TriangleMesh& mesh) {
  if (points.empty() || mesh.triangles.empty()) return 1.0;
  const Vector3 size = box_of(points).size_mm();
  const double area = size.x() * size.y() + size.y() * size.z() + size.z() * size.x();
  const double for_points = std::sqrt(kPointsPerGroup * area / static_cast<double>(points.size()));
  const double for_triangles = kTrianglesPerSide * std::sqrt(2.0 * surface_area_mm2(mesh) /
                                                             static_cast<double>(mesh.triangles.size()));
  return std::max(std::min(for_points, for_triangles), 1e-9);
}

GroupBall ball_about(const std::vector<Vector3>& points, const std::uint32_t* begin,
                     const std::uint32_t* end) {
  Box box;
  for (const std::uint32_t* p = begin; p != end; ++p) box.extend(points[*p]);
  return {box.centre_mm(), 0.5 * box.size_mm().norm() * (1.0 + 1e-9)};
}

}  // namespace gnathion
