#include "design/solid_distance.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/point_groups.h"

namespace gnathion {
namespace {

constexpr double kClearCosine = 0.9;   // faces have 1; beside edges and vertices rays are asked
constexpr double kOnSurfaceMm = 0.03;  // nearer than this the normal is right unless it lies across ...
constexpr double kCarefulMm = 0.004;   // ... or the scan folds; measurements ask rays down to here

/// Downwards and askew to the axes, edges and symmetry planes of any scan.
const Vector3 kDirections[3] = {Vector3(0.3217, 0.4871, -0.8119).normalized(),
                                Vector3(-0.7421, 0.2113, -0.6361).normalized(),
                                Vector3(0.1873, -0.8217, -0.5383).normalized()};

bool odd(const MeshQuery& solid, const Vector3& p, int direction) {
  return solid.count_crossings(p, kDirections[direction]) % 2 != 0;
}

/// So near to the surface that the closest normal tells the side.
bool side_by_normal(const Vector3& p_mm, const SignedDistance& d, double on_surface_mm = kOnSurfaceMm) {
  const double distance = std::abs(d.distance_mm);
  if (distance < 1e-4) return true;
  const Vector3 way = p_mm - d.closest.point_mm;
  const double cosine = way.dot(d.closest.normal) / (way.norm() * d.closest.normal.norm() + 1e-300);
  return distance < on_surface_mm && std::abs(cosine) >= kClearCosine;
}

/// The normal's word if a ray agrees, else the majority of three.
bool inside_by_rays(const MeshQuery& solid, const Vector3& p, bool by_normal) {
  if (odd(solid, p, 0) == by_normal) return by_normal;
  const int votes = (by_normal ? 0 : 1) + (odd(solid, p, 1) ? 1 : 0) + (odd(solid, p, 2) ? 1 : 0);
  return votes >= 2;
}

void set_side(SignedDistance& d, bool inside) {
  const double distance = std::abs(d.distance_mm);
  d.distance_mm = inside ? -distance : distance;
}

SolidHit hit_of(const SolidGroup::Point& p) {
  const ClosestPoint& closest = p.distance.closest;
  const double distance = p.distance.distance_mm;
  const bool off = std::abs(distance) > kCarefulMm;
  const Vector3 out = off ? Vector3((p.p_mm - closest.point_mm) / distance) : closest.normal;
  return {distance, closest.point_mm, out.normalized()};
}

}  // namespace

std::optional<SignedDistance> solid_distance(const MeshQuery& solid, const Vector3& p_mm,
                                             double max_distance_mm) {
  auto found = solid.signed_distance(p_mm, max_distance_mm);
  if (!found || side_by_normal(p_mm, *found)) return found;
  set_side(*found, inside_by_rays(solid, p_mm, found->distance_mm < 0.0));
  return found;
}

SolidGroup::SolidGroup(const MeshQuery& solid) : SolidGroup(solid, kOnSurfaceMm) {}
SolidGroup::SolidGroup(const MeshQuery& solid, double on_surface_mm)
    : solid_(solid), on_surface_mm_(on_surface_mm), local_(solid) {}

void SolidGroup::measure(std::vector<Point>& points) {
  if (points.empty()) return;
  Box box;
  double reach = 0.0;
  for (const Point& p : points) {
    box.extend(p.p_mm);
    reach = std::max(reach, p.reach_mm);
  }
  const bool any = local_.gather(box.centre_mm(), 0.5 * box.size_mm().norm() * (1.0 + 1e-9), reach);
  order_.clear();
  for (std::size_t i = 0; i < points.size(); ++i) {
    Point& p = points[i];
    const auto found = any ? local_.signed_distance(p.p_mm, p.reach_mm) : std::nullopt;
    p.found = found.has_value();
    if (!found) continue;
    p.distance = *found;
    if (!side_by_normal(p.p_mm, p.distance, on_surface_mm_)) order_.push_back(i);
  }
  // From the farthest on: each has its side from one before it whose ball meets its own, or by rays.
  std::sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) {
    const double da = std::abs(points[a].distance.distance_mm), db = std::abs(points[b].distance.distance_mm);
    return da != db ? da > db : a < b;
  });
  for (std::size_t n = 0; n < order_.size(); ++n) {
    Point& p = points[order_[n]];
    const double room = std::abs(p.distance.distance_mm);
    std::size_t before = 0;
    while (before < n) {
      const Point& q = points[order_[before]];
      const double reach_both = 0.999 * (room + std::abs(q.distance.distance_mm));
      if ((p.p_mm - q.p_mm).squaredNorm() < reach_both * reach_both) break;
      ++before;
    }
    set_side(p.distance, before < n ? points[order_[before]].distance.distance_mm < 0.0
                                    : inside_by_rays(solid_, p.p_mm, p.distance.distance_mm < 0.0));
  }
}

std::vector<SolidHit> solid_hits(const MeshQuery& solid, const std::vector<Vector3>& points,
                                 double max_distance_mm) {
  std::vector<SolidHit> out(points.size());
  if (points.empty()) return out;
  const PointGroups groups = grouped_by_place(points, group_side_mm(points, solid.mesh()));
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, groups.size(), 16), [&](const auto& range) {
    SolidGroup group(solid, kCarefulMm);
    std::vector<SolidGroup::Point> members;
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      members.clear();
      for (const std::uint32_t* p = groups.begin(g); p != groups.end(g); ++p)
        members.push_back({points[*p], max_distance_mm, false, {}});
      group.measure(members);
      for (std::size_t i = 0; i < members.size(); ++i)
        if (members[i].found) out[groups.begin(g)[i]] = hit_of(members[i]);
    }
  });
  return out;
}

}  // namespace gnathion
