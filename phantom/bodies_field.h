// Distance functions of simple solids and their smooth unions: the phantom's modelling clay.
//
// Each takes a point and gives its (about) signed distance in mm, negative inside. After Quilez,
// "Distance functions" (iquilezles.org), written anew.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/rigid.h"

namespace gnathion::field {

inline double sphere(const Vector3& p, const Vector3& centre, double radius) {
  return (p - centre).norm() - radius;
}

/// Cone-like rod with round ends; constant radius where the two are equal.
inline double rod(const Vector3& p, const Vector3& a, const Vector3& b, double radius_a, double radius_b) {
  const Vector3 along = b - a;
  const double t = std::clamp((p - a).dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (p - a - t * along).norm() - (radius_a + t * (radius_b - radius_a));
}
inline double rod(const Vector3& p, const Vector3& a, const Vector3& b, double radius) {
  return rod(p, a, b, radius, radius);
}

/// Box of half sides `half` with edges rounded by `rounding`, in its own axes.
inline double box(const Vector3& p_local, const Vector3& half, double rounding) {
  const Vector3 q = p_local.cwiseAbs() - half + Vector3::Constant(rounding);
  return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0) - rounding;
}

/// Ellipsoid with axes along x, y, z; a first-order distance, exact at the surface.
inline double ellipsoid(const Vector3& p, const Vector3& centre, const Vector3& radii) {
  const Vector3 q = p - centre;
  const double k0 = q.cwiseQuotient(radii).norm();
  const double k1 = q.cwiseQuotient(radii.cwiseProduct(radii)).norm();
  if (k1 < 1e-12) return -radii.minCoeff();
  return k0 * (k0 - 1.0) / k1;
}

/// Union, intersection and difference whose edges are filleted over about `k` mm.
inline double unite(double a, double b, double k) {
  const double h = std::max(k - std::abs(a - b), 0.0) / k;
  return std::min(a, b) - h * h * k * 0.25;
}
inline double intersect(double a, double b, double k) {
  return -unite(-a, -b, k);
}
inline double subtract(double a, double b, double k) {
  return intersect(a, -b, k);
}

/// 0 below `low`, 1 above `high`, smooth between.
inline double smooth_step(double low, double high, double x) {
  const double t = std::clamp((x - low) / (high - low), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

}  // namespace gnathion::field
