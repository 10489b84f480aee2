// One camera solved and checked: what a calibration, and a rig, go on from. Internal.
#pragma once

#include "calibration/camera_checks.h"
#include "calibration/camera_start.h"

namespace gnathion::camera_problem {

constexpr std::size_t kLeastCorners = 8;  ///< of a view
// Views are of two cameras when two sets of intrinsics leave less than this share of the residuals, and
// differ by so many standard deviations. Of the real pairs in docs/camera-calibration.md one camera, split in
// the best way, keeps 0.89 or more and comes to 15 σ (lens and board are not quite of the model); two mixed
// cameras 0.83 or less, and 21 σ or more.
constexpr double kTwoCamerasRatio = 0.86, kTwoCamerasSigmas = 17;

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
