#include "core/triangle_polygon.h"

#include <numeric>

#include "core/triangle_predicates.h"

namespace gnathion {
namespace {

constexpr std::size_t kMostCorners = 512;  // cutting ears takes n² steps at best

using Triangles = std::vector<std::array<std::uint32_t, 3>>;

/// Looks at the polygon along the coordinate axis nearest to its normal, from the side where it runs
/// counter-clockwise.
class PolygonView {
 public:
  explicit PolygonView(const std::vector<Vector3>& corners) : corners_(corners) {
    Vector3 normal = Vector3::Zero();
    const Vector3& origin = corners[0];
    for (std::size_t i = 1; i + 1 < corners.size(); ++i)
      normal += (corners[i] - origin).cross(corners[i + 1] - origin);
    int axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    x_ = (axis + 1) % 3;
    y_ = (axis + 2) % 3;
    if (normal[axis] < 0.0) std::swap(x_, y_);
  }
  /// +1 for a turn to the left.
  int turn(std::uint32_t a, std::uint32_t b, std::uint32_t c) const {
    return orient2d_sign(corners_[a], corners_[b], corners_[c], x_, y_);
  }
  bool same_place(std::uint32_t a, std::uint32_t b) const {
    return corners_[a][x_] == corners_[b][x_] && corners_[a][y_] == corners_[b][y_];
  }

 private:
  const std::vector<Vector3>& corners_;
  int x_ = 0, y_ = 1;
};

Triangles fan(std::size_t corners) {
  Triangles triangles;
  for (std::uint32_t k = 2; k < corners; ++k) triangles.push_back({0, k - 1, k});
  return triangles;
}

bool fan_keeps_winding(const PolygonView& view, std::size_t n) {
  for (std::uint32_t k = 2; k < n; ++k)
    if (view.turn(0, k - 1, k) <= 0) return false;
  return true;
}

bool is_ear(const PolygonView& view, const std::vector<std::uint32_t>& ring, std::size_t i) {
  const std::size_t n = ring.size();
  const std::uint32_t a = ring[(i + n - 1) % n], b = ring[i], c = ring[(i + 1) % n];
  if (view.turn(a, b, c) <= 0) return false;
  for (const std::uint32_t p : ring) {
    if (p == a || p == b || p == c || view.same_place(p, a) || view.same_place(p, b) || view.same_place(p, c))
      continue;
    if (view.turn(a, b, p) >= 0 && view.turn(b, c, p) >= 0 && view.turn(c, a, p) >= 0) return false;
  }
  return true;
}

}  // namespace

Triangles triangulated_polygon(const std::vector<Vector3>& corners_mm) {
  const std::size_t n = corners_mm.size();
  if (n < 3) return {};
  const PolygonView view(corners_mm);
  if (n == 3 || n > kMostCorners || fan_keeps_winding(view, n)) return fan(n);

  Triangles triangles;
  std::vector<std::uint32_t> ring(n);
  std::iota(ring.begin(), ring.end(), 0u);
  std::size_t i = 0, tried = 0;
  while (ring.size() > 3) {
    if (tried > ring.size()) return fan(n);  // no ear: it crosses itself
    i %= ring.size();
    if (!is_ear(view, ring, i)) {
      ++i;
      ++tried;
      continue;
    }
    const std::size_t m = ring.size();
    triangles.push_back({ring[(i + m - 1) % m], ring[i], ring[(i + 1) % m]});
    ring.erase(ring.begin() + static_cast<std::ptrdiff_t>(i));
    tried = 0;
    ++i;  // the next ear elsewhere: fewer slivers
  }
  triangles.push_back({ring[0], ring[1], ring[2]});
  return triangles;
}

}  // namespace gnathion
