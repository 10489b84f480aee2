// closest_points(): many queries at once. Points are grouped by place, each group asks a LocalQuery.
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>

#include "core/mesh_query.h"

namespace gnathion {
namespace {

constexpr std::size_t kFewPoints = 3;  // gathering does not pay below
constexpr double kPointsPerGroup = 32;

struct Placed {
  std::uint64_t cell;
  std::uint32_t point;
  bool operator<(const Placed& b) const { return cell != b.cell ? cell < b.cell : point < b.point; }
};

/// Spreads the low 21 bits so that two zeros follow each (Morton order).
std::uint64_t spread(std::uint64_t x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x1f00000000ffffULL;
  x = (x | x << 16) & 0x1f0000ff0000ffULL;
  x = (x | x << 8) & 0x100f00f00f00f00fULL;
  x = (x | x << 4) & 0x10c30c30c30c30c3ULL;
  return (x | x << 2) & 0x1249249249249249ULL;
}

/// Side of the cells: about kPointsPerGroup points in one where a surface passes it, and not wider than a few
/// triangles, or each point would have too many candidates.
double cell_side_mm(const Box& box, std::size_t points, const TriangleMesh& mesh) {
  const Vector3 size = box.size_mm();
  const double area = size.x() * size.y() + size.y() * size.z() + size.z() * size.x();
  const double for_points = std::sqrt(kPointsPerGroup * area / static_cast<double>(points));
  const double for_triangles =
      1.5 * std::sqrt(2.0 * surface_area_mm2(mesh) / static_cast<double>(mesh.triangles.size()));
  const double least = size.maxCoeff() / static_cast<double>(1 << 20);
  return std::max({std::min(for_points, for_triangles), least, 1e-9});
}

ClosestHit hit_from(const std::optional<SignedDistance>& found) {
  ClosestHit hit;
  if (!found) return hit;
  hit.triangle = found->closest.triangle;
  hit.distance_mm = found->distance_mm;
  hit.point_mm = found->closest.point_mm;
  hit.normal = found->closest.normal;
  hit.on_boundary = found->closest.on_boundary;
  return hit;
}

void search_group(const MeshQuery& query, LocalQuery& local, const std::vector<Vector3>& points,
                  const Placed* begin, const Placed* end, double max_distance_mm,
                  std::vector<ClosestHit>& hits) {
  const auto count = static_cast<std::size_t>(end - begin);
  if (count <= kFewPoints) {
    for (const Placed* p = begin; p != end; ++p)
      hits[p->point] = hit_from(query.signed_distance(points[p->point], max_distance_mm));
    return;
  }
  Box box;
  for (const Placed* p = begin; p != end; ++p) box.extend(points[p->point]);
  const double radius = 0.5 * box.size_mm().norm() * (1.0 + 1e-9);
  if (!local.gather(box.centre_mm(), radius, max_distance_mm)) return;
  for (const Placed* p = begin; p != end; ++p)
    hits[p->point] = hit_from(local.signed_distance(points[p->point], max_distance_mm));
}

}  // namespace

std::vector<ClosestHit> closest_points(const MeshQuery& query, const std::vector<Vector3>& points,
                                       double max_distance_mm) {
  std::vector<ClosestHit> hits(points.size());
  if (points.empty() || query.mesh().empty()) return hits;
  Box box;
  for (const Vector3& p : points)
    if (p.allFinite()) box.extend(p);
  const double side = cell_side_mm(box, points.size(), query.mesh());
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
  std::vector<std::size_t> starts;
  for (std::size_t i = 0; i < placed.size(); ++i)
    if (i == 0 || placed[i].cell != placed[i - 1].cell) starts.push_back(i);
  starts.push_back(placed.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, starts.size() - 1, 16), [&](const auto& range) {
    LocalQuery local(query);
    for (std::size_t g = range.begin(); g != range.end(); ++g)
      search_group(query, local, points, &placed[starts[g]], placed.data() + starts[g + 1], max_distance_mm,
                   hits);
  });
  return hits;
}

}  // namespace gnathion
