#include "design/swept_depth.h"

#include <algorithm>
#include <cmath>

#include "design/parallel.h"

namespace gnathion {
namespace {

constexpr double kCellMm = 0.25;
constexpr double kSampleMm = 0.1;
constexpr int kMostSamples = 40;
constexpr double kLeastDepthMm = 0.005;  // shallower chords are not looked at
constexpr double kPastHitMm = 1e-5;
constexpr int kMostHits = 64;

/// Where the solid lies in each column along the direction, for points that pass it by.
class Columns {
 public:
  Columns(const TriangleMesh& solid, const Vector3& direction) {
    axes_.col(2) = direction;
    axes_.col(0) = direction.unitOrthogonal();
    axes_.col(1) = direction.cross(axes_.col(0));
    Box box;
    std::vector<Vector3> turned;
    for (const Vector3& v : solid.vertices_mm) {
      turned.push_back(axes_.transpose() * v);
      box.extend(turned.back());
    }
    low_ = box.min_mm;
    nx_ = static_cast<int>(box.size_mm().x() / kCellMm) + 1;
    ny_ = static_cast<int>(box.size_mm().y() / kCellMm) + 1;
    ends_.assign(static_cast<std::size_t>(nx_) * static_cast<std::size_t>(ny_), {1e300, -1e300});
    for (const Triangle& t : solid.triangles) {
      Box part;
      for (const std::uint32_t v : t) part.extend(turned[v]);
      for (int i = cell(part.min_mm.x(), 0); i <= cell(part.max_mm.x(), 0); ++i)
        for (int j = cell(part.min_mm.y(), 1); j <= cell(part.max_mm.y(), 1); ++j) {
          auto& [first, last] = ends_[index(i, j)];
          first = std::min(first, part.min_mm.z());
          last = std::max(last, part.max_mm.z());
        }
    }
  }

  /// False where the way from p cannot meet the solid.
  bool may_meet(const Vector3& p, double length_mm) const {
    const Vector3 q = axes_.transpose() * p;
    const int i = cell(q.x(), 0), j = cell(q.y(), 1);
    if (i < 0 || j < 0 || i >= nx_ || j >= ny_) return false;
    const auto& [first, last] = ends_[index(i, j)];
    return last > q.z() + kLeastDepthMm && first < q.z() + length_mm;
  }

 private:
  int cell(double x, int axis) const { return static_cast<int>(std::floor((x - low_[axis]) / kCellMm)); }
  std::size_t index(int i, int j) const {
    return static_cast<std::size_t>(i) * static_cast<std::size_t>(ny_) + static_cast<std::size_t>(j);
  }
  Matrix3 axes_;
  Vector3 low_ = Vector3::Zero();
  int nx_ = 0, ny_ = 0;
  std::vector<std::pair<double, double>> ends_;
};

/// Depth along one chord, whose ends are on the surface, but for the start of a way that begins inside.
void sample_chord(const Vector3& p, const Vector3& direction, double from_mm, double to_mm,
                  bool begins_inside, const MeshQuery& solid, SweptDepth& best) {
  const double length = to_mm - from_mm;
  if ((begins_inside ? 1.0 : 0.5) * length <= std::max(kLeastDepthMm, best.depth_mm))
    return;  // nothing of it lies deeper
  const int samples = std::clamp(static_cast<int>(std::ceil(length / kSampleMm)), 2, kMostSamples);
  for (int n = begins_inside ? 0 : 1; n < samples; ++n) {
    const double way = from_mm + length * n / samples;
    const double nearest_end = begins_inside ? to_mm - way : std::min(way - from_mm, to_mm - way);
    if (nearest_end <= best.depth_mm) continue;
    const auto closest = solid.closest(p + way * direction, nearest_end);
    const double depth = closest ? closest->distance_mm : nearest_end;
    if (depth > best.depth_mm) best = {depth, way, p};
  }
}

/// Depths up to `past_mm` are not looked for.
SweptDepth along_way(const Vector3& p, const Vector3& direction, double length_mm, const MeshQuery& solid,
                     double past_mm) {
  SweptDepth best;
  best.depth_mm = past_mm;
  double at = 0.0, entered = 0.0;
  for (int hits = 0; hits < kMostHits && at < length_mm; ++hits) {
    const auto hit = solid.ray(p, direction, at, 1e6);
    if (!hit) break;
    const bool leaves = hit->normal.dot(direction) > 0.0;
    if (leaves) sample_chord(p, direction, entered, hit->distance_mm, hits == 0, solid, best);
    entered = hit->distance_mm;
    at = hit->distance_mm + kPastHitMm;
  }
  if (best.depth_mm <= past_mm) best.depth_mm = 0.0;
  return best;
}

}  // namespace

std::vector<SweptDepth> depths_on_way(const std::vector<Vector3>& points, const Vector3& direction,
                                      double length_mm, const MeshQuery& solid, double past_mm) {
  const Columns columns(solid.mesh(), direction);
  std::vector<SweptDepth> each(points.size());
  parallel_each(points.size(), [&](std::size_t i) {
    if (columns.may_meet(points[i], length_mm))
      each[i] = along_way(points[i], direction, length_mm, solid, past_mm);
  });
  return each;
}

SweptDepth deepest_on_way(const std::vector<Vector3>& points, const Vector3& direction, double length_mm,
                          const MeshQuery& solid) {
  SweptDepth best;
  for (const SweptDepth& one : depths_on_way(points, direction, length_mm, solid, 0.0))
    if (one.depth_mm > best.depth_mm) best = one;
  return best;
}

}  // namespace gnathion
