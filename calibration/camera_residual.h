// One corner of a board in one camera of a rig: pixel and its derivatives. Internal to the calibration of
// cameras.
#pragma once

#include <Eigen/Core>

#include "calibration/camera_calibration.h"

namespace gnathion::camera_problem {

constexpr int kBend = 3;
using Vector2 = Eigen::Vector2d;
using Bend = Eigen::Vector3d;

/// A point of the board: flat coordinates, and where it stands for the board's bend (1 at the farthest
/// corner).
struct BoardPoint {
  Vector3 flat_mm;
  double u = 0, v = 0;

  /// z = a·u² + b·u·v + c·v², mm.
  Vector3 bent_mm(const Bend& bend) const {
    return flat_mm + Vector3(0, 0, bend[0] * u * u + bend[1] * u * v + bend[2] * v * v);
  }
};
std::vector<BoardPoint> board_points(const CalibrationBoard& board);

/// d(pixel) by each block; rotations and translations by left perturbations.
struct PixelDerivatives {
  Eigen::Matrix<double, 2, kIntrinsics> intrinsics;
  Eigen::Matrix<double, 2, 6> rig_from_camera, rig_from_board;
  Eigen::Matrix<double, 2, kBend> bend;
};

/// Pixel of the point; false where it lies behind the camera.
bool project(const Vector9& intrinsics, const Rigid3& rig_from_camera, const Rigid3& rig_from_board,
             const BoardPoint& point, const Bend& bend, Vector2* pixel, PixelDerivatives* derivatives);

CameraModel model_of(const Vector9& intrinsics, int width_px, int height_px);

}  // namespace gnathion::camera_problem
