// Intrinsics of one camera from the corners of a board in many views.
//
// Pinhole with Brown–Conrady distortion. Start after Zhang (2000) with the principal point in the middle;
// then all intrinsics and all poses at once in Ceres, residuals whitened by the corners' covariances,
// Cauchy's loss.
#pragma once

#include <string>
#include <vector>

#include "core/calibration_board.h"
#include "core/camera_model.h"
#include "core/progress.h"

namespace gnathion {

/// fx, fy, cx, cy, k1, k2, p1, p2, k3: the order of every covariance.
constexpr int kIntrinsics = 9;
using Vector9 = Eigen::Matrix<double, kIntrinsics, 1>;
using Matrix9 = Eigen::Matrix<double, kIntrinsics, kIntrinsics>;
Vector9 intrinsics_of(const CameraModel& model);
const std::vector<std::string>& intrinsic_names();  ///< "fx_px", …

struct CameraCalibrationOptions {
  bool estimate_k3 = true;   ///< otherwise 0
  int folds = 10;            ///< of the cross-validation; as many as views where those are fewer
  int min_views = 3;         ///< distinct ones; fewer are refused
  int few_views = 8;         ///< fewer are warned of
  double loss_sigmas = 3.0;  ///< Cauchy's scale
};

/// What became of one view.
struct ViewResult {
  std::string name;
  std::size_t corners = 0;
  double rms_px = 0;       ///< √(mean of dx² + dy²), as OpenCV's
  double held_out_px = 0;  ///< the same with intrinsics from other views (see CameraCalibration)
  double tilt_deg = 0;     ///< between the board's normal and the line of sight
  Rigid3 camera_from_board;
  std::vector<Eigen::Vector2d> corners_px;    ///< measured
  std::vector<Eigen::Vector2d> residuals_px;  ///< measured − predicted, in the order of the view's corners
};

/// Corners counted in cells of the image.
struct CoverageMap {
  int columns = 8, rows = 6;
  std::vector<int> counts;        ///< row by row
  double covered_share = 0;       ///< of the cells that hold a corner
  double radius_share = 0;        ///< farthest corner from the principal point over the farthest pixel
  std::vector<std::string> thin;  ///< parts of the image without corners, in words
};

/// Bend of the board, z = a·x² + b·x·y + c·y² about its centre: the largest deviation from a plane.
struct BoardBend {
  double sag_mm = 0, sigma_mm = 0;
  bool significant = false;
};

struct CameraCalibration {
  CameraModel model;
  Matrix9 covariance = Matrix9::Zero();  ///< scaled by the observed noise
  double rms_px = 0;                     ///< over all corners of the views used, √(mean of dx² + dy²)
  /// Cross-validation over views: intrinsics from the other folds; in each view left out the pose comes from
  /// one half of its corners (every second id) and the error from the other half, then the other way round.
  double held_out_px = 0;
  double noise_scale = 1;     ///< √(χ²/dof): 1 where the detector's covariances tell all
  double extra_noise_px = 0;  ///< noise found beyond the detector's, per coordinate
  std::vector<ViewResult> views;
  std::vector<std::string> dropped;  ///< "left03.jpg: the same as left02.jpg"
  CoverageMap coverage;
  BoardBend bend;
  double focal_drift_share = 0;  ///< spread of the focal length from view to view beyond its noise, over f
  std::vector<std::string> warnings;

  double sigma(int k) const { return std::sqrt(covariance(k, k)); }
  /// Standard deviation of the mean focal length, (fx + fy)/2.
  double focal_sigma_px() const;
};

/// `name` stands in messages. Refused (kInput): fewer than min_views distinct views, a focal length that the
/// views do not determine, views of two cameras, corners that no pinhole camera makes.
Result<CameraCalibration> calibrate_camera(const CalibrationBoard& board, const std::string& name,
                                           int width_px, int height_px, const std::vector<BoardView>& views,
                                           const CameraCalibrationOptions& options, Progress& progress);

}  // namespace gnathion
