#include "core/triangle_distance.h"

#include <algorithm>
#include <limits>

namespace gnathion {
namespace {

TrianglePoint at_vertex(const Vector3& p, const Vector3& corner, int k) {
  TrianglePoint result;
  result.point_mm = corner;
  result.barycentric[k] = 1.0;
  result.feature = static_cast<TriangleFeature>(static_cast<int>(TriangleFeature::kVertex0) + k);
  result.squared_distance = (p - corner).squaredNorm();
  return result;
}

/// On the segment between corners k and k+1.
TrianglePoint on_segment(const Vector3& p, const Vector3& from, const Vector3& to, int k) {
  const Vector3 along = to - from;
  const double length2 = along.squaredNorm();
  const double s = length2 > 0.0 ? along.dot(p - from) / length2 : 0.0;
  if (!(s > 0.0)) return at_vertex(p, from, k);
  if (s >= 1.0) return at_vertex(p, to, (k + 1) % 3);
  TrianglePoint result;
  result.point_mm = from + s * along;
  result.barycentric[k] = 1.0 - s;
  result.barycentric[(k + 1) % 3] = s;
  result.feature = static_cast<TriangleFeature>(static_cast<int>(TriangleFeature::kEdge0) + k);
  result.squared_distance = (p - result.point_mm).squaredNorm();
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
  TrianglePoint best;
  best.squared_distance = std::numeric_limits<double>::infinity();
  const auto consider = [&](const TrianglePoint& other) {
    if (other.squared_distance < best.squared_distance) best = other;
  };
  if (!(w > 0.0)) consider(on_segment(p, a, b, 0));
  if (!(u > 0.0)) consider(on_segment(p, b, c, 1));
  if (!(v > 0.0)) consider(on_segment(p, c, a, 2));
  return best;
}

}  // namespace gnathion
