#include "calibration/camera_residual.h"

#include <algorithm>

namespace gnathion {

Vector9 intrinsics_of(const CameraModel& m) {
  Vector9 x;
  x << m.fx_px, m.fy_px, m.cx_px, m.cy_px, m.k1, m.k2, m.p1, m.p2, m.k3;
  return x;
}

const std::vector<std::string>& intrinsic_names() {
  static const std::vector<std::string> names = {"fx_px", "fy_px", "cx_px", "cy_px", "k1",
                                                 "k2",    "p1",    "p2",    "k3"};
  return names;
}

namespace camera_problem {

std::vector<BoardPoint> board_points(const CalibrationBoard& board) {
  const std::vector<Vector3> flat = board.points_mm();
  Vector3 low = flat.front(), high = flat.front();
  for (const Vector3& p : flat) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vector3 middle = 0.5 * (low + high);
  const double half = 0.5 * (high - low).norm();
  std::vector<BoardPoint> points;
  for (const Vector3& p : flat) points.push_back({p, (p - middle).x() / half, (p - middle).y() / half});
  return points;
}

bool project(const Vector9& k, const Rigid3& rig_from_camera, const Rigid3& rig_from_board,
             const BoardPoint& point, const Bend& bend, Vector2* pixel, PixelDerivatives* out) {
  const Vector3 in_rig = rig_from_board * point.bent_mm(bend);
  const Matrix3 turn = rig_from_camera.rotation.transpose();
  const Vector3 p = turn * (in_rig - rig_from_camera.translation_mm);
  if (!(p.z() > 1e-3)) return false;
  const double iz = 1 / p.z(), x = p.x() * iz, y = p.y() * iz, r2 = x * x + y * y;
  const double fx = k[0], fy = k[1], k1 = k[4], k2 = k[5], p1 = k[6], p2 = k[7], k3 = k[8];
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x);
  const double yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y;
  *pixel = {fx * xd + k[2], fy * yd + k[3]};
  if (out == nullptr) return true;
  const double r4 = r2 * r2, r6 = r4 * r2;
  out->intrinsics << xd, 0, 1, 0, fx * x * r2, fx * x * r4, fx * 2 * x * y, fx * (r2 + 2 * x * x),
      fx * x * r6,  //
      0, yd, 0, 1, fy * y * r2, fy * y * r4, fy * (r2 + 2 * y * y), fy * 2 * x * y, fy * y * r6;
  const double slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3));
  const double xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x;
  const double xy = x * y * slope + 2 * p1 * x + 2 * p2 * y;
  const double yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x;
  Eigen::Matrix<double, 2, 3> by_point;
  by_point << fx * xx * iz, fx * xy * iz, -fx * (xx * x + xy * y) * iz,  //
      fy * xy * iz, fy * yy * iz, -fy * (xy * x + yy * y) * iz;
  const Eigen::Matrix<double, 2, 3> by_rig = by_point * turn;
  out->rig_from_board << -by_rig * skew(in_rig), by_rig;
  out->rig_from_camera = -out->rig_from_board;
  out->bend = (by_rig * rig_from_board.rotation.col(2)) *
              Eigen::RowVector3d(point.u * point.u, point.u * point.v, point.v * point.v);
  return true;
}

CameraModel model_of(const Vector9& k, int width_px, int height_px) {
  CameraModel m;
  m.width_px = width_px;
  m.height_px = height_px;
  m.fx_px = k[0], m.fy_px = k[1], m.cx_px = k[2], m.cy_px = k[3];
  m.k1 = k[4], m.k2 = k[5], m.p1 = k[6], m.p2 = k[7], m.k3 = k[8];
  return m;
}

}  // namespace camera_problem
}  // namespace gnathion
