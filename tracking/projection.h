// Projection with its Jacobian, for the solvers.
#pragma once

#include <Eigen/Core>

#include "core/camera_model.h"

namespace gnathion {

/// Pixel of a point with z > 0 and d(pixel)/d(point), 2×3. The same model as CameraModel::project.
inline Eigen::Vector2d project_with_jacobian(const CameraModel& c, const Vector3& p,
                                             Eigen::Matrix<double, 2, 3>* jacobian) {
  const double iz = 1.0 / p.z(), x = p.x() * iz, y = p.y() * iz;
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
  const double slope = 2 * (c.k1 + r2 * (2 * c.k2 + 3 * r2 * c.k3));  // d radial / d(r²), times 2
  const double xd = x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x * x);
  const double yd = y * radial + c.p1 * (r2 + 2 * y * y) + 2 * c.p2 * x * y;
  if (jacobian != nullptr) {
    const double xx = radial + x * x * slope + 2 * c.p1 * y + 6 * c.p2 * x;
    const double xy = x * y * slope + 2 * c.p1 * x + 2 * c.p2 * y;
    const double yy = radial + y * y * slope + 6 * c.p1 * y + 2 * c.p2 * x;
    *jacobian << c.fx_px * xx * iz, c.fx_px * xy * iz, -c.fx_px * (xx * x + xy * y) * iz,  //
        c.fy_px * xy * iz, c.fy_px * yy * iz, -c.fy_px * (xy * x + yy * y) * iz;
  }
  return {c.fx_px * xd + c.cx_px, c.fy_px * yd + c.cy_px};
}

}  // namespace gnathion
