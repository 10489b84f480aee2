// Distances to simple solids, mm, negative inside: what carrier, stem and band are made of. Private to
// design/bow/. (Quilez, "Distance functions", iquilezles.org, for the forms.)
#pragma once

#include <algorithm>
#include <cmath>

#include "core/rigid.h"

namespace gnathion::shape {

/// Box of half sides `half` about the origin of its own axes, edges rounded with `rounding`.
inline double block(const Vector3& p_local, const Vector3& half, double rounding) {
  const Vector3 q = p_local.cwiseAbs() - half + Vector3::Constant(rounding);
  return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0) - rounding;
}

inline double capsule(const Vector3& p, const Vector3& a, const Vector3& b, double radius) {
  const Vector3 along = b - a;
  const double t = std::clamp((p - a).dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (p - a - t * along).norm() - radius;
}

inline double ball(const Vector3& p, const Vector3& centre, double radius) {
  return (p - centre).norm() - radius;
}

/// Union with a fillet of about `k` mm.
inline double join(double a, double b, double k) {
  const double h = std::max(k - std::abs(a - b), 0.0) / k;
  return std::min(a, b) - 0.25 * h * h * k;
}
/// Intersection with an edge rounded over about `k` mm.
inline double meet(double a, double b, double k) {
  return -join(-a, -b, k);
}

}  // namespace gnathion::shape
