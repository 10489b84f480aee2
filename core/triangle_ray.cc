#include "core/triangle_ray.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace gnathion {

RayInDouble::RayInDouble(const Vector3& origin_mm, const Vector3& direction, double start_mm)
    : origin_(origin_mm),
      direction_(direction),
      start_(origin_mm + start_mm * direction),
      start_mm_(start_mm) {
  direction.cwiseAbs().maxCoeff(&z_);
  x_ = (z_ + 1) % 3;
  y_ = (z_ + 2) % 3;
  if (direction[z_] < 0.0) std::swap(x_, y_);  // keeps the winding
  shear_x_ = direction[x_] / direction[z_];
  shear_y_ = direction[y_] / direction[z_];
  shear_z_ = 1.0 / direction[z_];
}

RayCrossing RayInDouble::cross(const Vector3& a, const Vector3& b, const Vector3& c) const {
  const Vector3 pa = a - start_, pb = b - start_, pc = c - start_;
  // The ray becomes the z axis; what is left is a point-in-triangle test about the origin of the plane.
  const double ax = pa[x_] - shear_x_ * pa[z_], ay = pa[y_] - shear_y_ * pa[z_];
  const double bx = pb[x_] - shear_x_ * pb[z_], by = pb[y_] - shear_y_ * pb[z_];
  const double cx = pc[x_] - shear_x_ * pc[z_], cy = pc[y_] - shear_y_ * pc[z_];
  const double u = cx * by - cy * bx, v = ax * cy - ay * cx, w = bx * ay - by * ax;
  if ((u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0)) return {};
  const double det = u + v + w;
  if (det == 0.0) return {RayCrossing::kEdgeOn, 0.0};

  RayCrossing crossing;
  crossing.distance_mm = start_mm_ + shear_z_ * (u * pa[z_] + v * pb[z_] + w * pc[z_]) / det;
  if (crossing.distance_mm < start_mm_) return {};
  // An edge function is a difference of products that carry the rounding of the coordinates.
  const double reach =
      std::max({std::abs(ax), std::abs(ay), std::abs(bx), std::abs(by), std::abs(cx), std::abs(cy)});
  const double size =
      std::max({pa.cwiseAbs().maxCoeff(), pb.cwiseAbs().maxCoeff(), pc.cwiseAbs().maxCoeff()});
  const double unsure = 1e-14 * reach * size;
  const bool rim = std::abs(u) <= unsure || std::abs(v) <= unsure || std::abs(w) <= unsure;
  crossing.kind = rim ? RayCrossing::kOnRim : RayCrossing::kInside;
  return crossing;
}

}  // namespace gnathion
