#include "core/triangle_distance.h"

#include <algorithm>
#include <limits>

namespace gnathion {
namespace {

/// The point of one side that is closest, before it is written out.
struct OnSide {
  double s = 0.0;  ///< from corner k (0) to corner k + 1 (1)
  double squared_distance = std::numeric_limits<double>::infinity();
  int k = 0;
};

/// On the segment between corners k and k+1; kept if it is closer.
inline void consider_segment(const Vector3& p, const Vector3& from, const Vector3& to, int k, OnSide& best) {
  const Vector3 along = to - from;
  const double length2 = along.squaredNorm();
  const double s = length2 > 0.0 ? along.dot(p - from) / length2 : 0.0;
  OnSide found{0.0, 0.0, k};
  if (!(s > 0.0)) {
    found.squared_distance = (p - from).squaredNorm();
  } else if (s >= 1.0) {
    found.s = 1.0;
    found.squared_distance = (p - to).squaredNorm();
  } else {
    found.s = s;
    found.squared_distance = (p - (from + s * along)).squaredNorm();
  }
  if (found.squared_distance < best.squared_distance) best = found;
}

TrianglePoint written_out(const OnSide& side, const Vector3& from, const Vector3& to) {
  TrianglePoint result;
  const int k = side.k, next = (k + 1) % 3;
  result.squared_distance = side.squared_distance;
  const auto feature = [](TriangleFeature first, int i) {
    return static_cast<TriangleFeature>(static_cast<int>(first) + i);
  };
  if (side.s == 0.0 || side.s == 1.0) {
    const bool at_from = side.s == 0.0;
    result.point_mm = at_from ? from : to;
    result.barycentric[at_from ? k : next] = 1.0;
    result.feature = feature(TriangleFeature::kVertex0, at_from ? k : next);
    return result;
  }
  result.point_mm = from + side.s * (to - from);
  result.barycentric[k] = 1.0 - side.s;
  result.barycentric[next] = side.s;
  result.feature = feature(TriangleFeature::kEdge0, k);
  return result;
}

}  // namespace

TrianglePoint closest_on_triangle(const Vector3& p, const Vector3& a, const Vector3& b, const Vector3& c) {
  const Vector3 ab = b - a, ac = c - a, n = ab.cross(ac);
  const double n2 = n.squaredNorm();
  const double longest2 = std::max({ab.squaredNorm(), ac.squaredNorm(), (c - b).squaredNorm()});
  double u = -1.0, v = -1.0, w = -1.0;
  // Heights below 1e-9 of the longest side are beneath what the inside test can resolve.
  if (n2 > 1e-18 * longest2 * longest2) {
    // Barycentric coordinates of p's foot in the plane; inside if all three are positive.
    const Vector3 ap = p - a;
    v = n.dot(ap.cross(ac)) / n2;
    w = n.dot(ab.cross(ap)) / n2;
    u = 1.0 - v - w;
    if (u > 0.0 && v > 0.0 && w > 0.0) {
      TrianglePoint result;
      result.barycentric = {u, v, w};
      result.point_mm = a + v * ab + w * ac;
      const double height = n.dot(ap);
      result.squared_distance = height * height / n2;
      return result;
    }
  }
  // The foot is outside: the closest point is on a side that has the foot on its outer side. From anywhere
  // else on the rim a step towards p would stay in the triangle and come nearer.
  OnSide best;
  if (!(w > 0.0)) consider_segment(p, a, b, 0, best);
  if (!(u > 0.0)) consider_segment(p, b, c, 1, best);
  if (!(v > 0.0)) consider_segment(p, c, a, 2, best);
  const Vector3* const corners[3] = {&a, &b, &c};
  return written_out(best, *corners[best.k], *corners[(best.k + 1) % 3]);
}

}  // namespace gnathion
