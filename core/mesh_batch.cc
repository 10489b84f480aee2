// closest_points(): many queries at once. Points are grouped by place, each group asks a LocalQuery.
#include <tbb/parallel_for.h>

#include "core/mesh_query.h"
#include "core/point_groups.h"

namespace gnathion {
namespace {

constexpr std::ptrdiff_t kFewPoints = 3;  // gathering does not pay for so few

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

}  // namespace

std::vector<ClosestHit> closest_points(const MeshQuery& query, const std::vector<Vector3>& points,
                                       double max_distance_mm) {
  std::vector<ClosestHit> hits(points.size());
  if (points.empty() || query.mesh().empty()) return hits;
  const PointGroups groups = grouped_by_place(points, group_side_mm(points, query.mesh()));
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, groups.size(), 16), [&](const auto& range) {
    LocalQuery local(query);
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      const std::uint32_t *begin = groups.begin(g), *end = groups.end(g);
      const bool few = end - begin <= kFewPoints;
      if (!few) {
        const GroupBall ball = ball_about(points, begin, end);
        if (!local.gather(ball.centre_mm, ball.radius_mm, max_distance_mm)) continue;
      }
      for (const std::uint32_t* p = begin; p != end; ++p)
        hits[*p] = hit_from(few ? query.signed_distance(points[*p], max_distance_mm)
                                : local.signed_distance(points[*p], max_distance_mm));
    }
  });
  return hits;
}

}  // namespace gnathion
