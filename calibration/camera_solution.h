// One camera solved and checked: what a calibration, and a rig, go on from. Internal.
#pragma once

#include "calibration/camera_checks.h"
#include "calibration/camera_start.h"

namespace gnathion::camera_problem {

constexpr std::size_t kLeastCorners = 8;  ///< of a view
// Views are of two cameras when two sets of intrinsics leave less than this share of the residuals, and
// differ by so many standard deviations. One camera, split in the best way, keeps more:
// docs/camera-calibration.md.
constexpr double kTwoCamerasRatio = 0.6, kTwoCamerasSigmas = 20;

struct CameraSolution {
  std::string name;
  int width_px = 0, height_px = 0;
  Problem problem;
  State state;
  std::vector<std::string> names;    ///< of the instants
  std::vector<std::string> dropped;  ///< views, with the reason
  double noise_scale = 1, focal_drift_share = 0;
  std::optional<Eigen::MatrixXd> covariance;
  std::size_t outliers() const;
};

Result<CameraSolution> solve_camera(const CalibrationBoard& board, const std::string& name, int width_px,
                                    int height_px, const std::vector<BoardView>& views,
                                    const CameraCalibrationOptions& options);
/// With cross-validation, coverage, bend and warnings.
CameraCalibration calibration_of(const CameraSolution& solution, const CameraCalibrationOptions& options);
ViewResult result_of(const Problem& problem, const State& state, const View& view, const std::string& name);

}  // namespace gnathion::camera_problem
