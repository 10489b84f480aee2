#include "core/camera_model.h"

#include <cmath>

namespace gnathion {
namespace {

/// Brown–Conrady with its Jacobian (Brown 1966; the form of OpenCV's documentation).
Eigen::Vector2d distort_with_jacobian(const CameraModel& c, const Eigen::Vector2d& n,
                                      Eigen::Matrix2d* jacobian) {
  const double x = n.x(), y = n.y(), r2 = x * x + y * y;
  const double radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
  const double slope = c.k1 + r2 * (2 * c.k2 + 3 * c.k3 * r2);  // d radial / d r²
  if (jacobian) {
    const double cross = 2 * x * y * slope + 2 * c.p1 * x + 2 * c.p2 * y;
    *jacobian << radial + 2 * x * x * slope + 2 * c.p1 * y + 6 * c.p2 * x, cross, cross,
        radial + 2 * y * y * slope + 6 * c.p1 * y + 2 * c.p2 * x;
  }
  return {x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x * x),
          y * radial + c.p1 * (r2 + 2 * y * y) + 2 * c.p2 * x * y};
}

}  // namespace

std::optional<Eigen::Vector2d> CameraModel::project(const Vector3& p) const {
  if (p.z() <= 0) return std::nullopt;
  const Eigen::Vector2d d = distort({p.x() / p.z(), p.y() / p.z()});
  return Eigen::Vector2d(fx_px * d.x() + cx_px, fy_px * d.y() + cy_px);
}

Eigen::Vector2d CameraModel::distort(const Eigen::Vector2d& normalised) const {
  return distort_with_jacobian(*this, normalised, nullptr);
}

Eigen::Vector2d CameraModel::undistorted(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d target((pixel.x() - cx_px) / fx_px, (pixel.y() - cy_px) / fy_px);
  Eigen::Vector2d n = target;
  for (int i = 0; i < 4; ++i) n += target - distort(n);  // fixed point: safe far from the solution
  for (int i = 0; i < 20; ++i) {
    Eigen::Matrix2d j;
    const Eigen::Vector2d residual = target - distort_with_jacobian(*this, n, &j);
    const Eigen::Vector2d step = j.inverse() * residual;
    n += step;
    if (step.norm() < 1e-14) break;
  }
  return n;
}

}  // namespace gnathion
