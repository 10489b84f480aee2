// Two or more cameras that see one board at the same instants: all intrinsics, all poses and the rig at once.
#pragma once

#include "calibration/camera_calibration.h"

namespace gnathion {

/// One camera's views; views of one name (in several cameras) are of one instant.
struct RigCameraViews {
  std::string name;
  int width_px = 0, height_px = 0;
  std::vector<BoardView> views;
};

struct RigCameraResult {
  std::string name;
  CameraCalibration camera;              ///< of the joint solution
  Rigid3 rig_from_camera;                ///< the first camera's is the identity
  Matrix6 covariance = Matrix6::Zero();  ///< of its left perturbation, rad, mm
  /// The board's pose from the first camera that sees it predicts the corners here; error without this
  /// camera's own part. Cross-validation over instants. 0 for the first camera.
  double held_out_rig_px = 0;
};

struct RigCalibration {
  std::vector<RigCameraResult> cameras;
  double rms_px = 0;       ///< over all corners of all cameras
  double held_out_px = 0;  ///< over all cameras but the first: held_out_rig_px
  double noise_scale = 1;
  std::size_t shared_instants = 0;  ///< seen by two cameras or more
  Eigen::MatrixXd
      covariance;  ///< intrinsics of each camera in turn, then rig_from_camera of all but the first
  std::vector<std::string> warnings;
};

/// Refused (kInput): what calibrate_camera refuses, cameras that never see the board together (names the
/// groups), and views whose cameras do not stand still to one another.
Result<RigCalibration> calibrate_rig(const CalibrationBoard& board,
                                     const std::vector<RigCameraViews>& cameras,
                                     const CameraCalibrationOptions& options, Progress& progress);

}  // namespace gnathion
