// Two images of one moment and the rig that took them, to a surface with deviations.
#pragma once

#include <string>
#include <vector>

#include "acquisition/scanner/depth_grid.h"
#include "acquisition/scanner/scan_ply.h"
#include "core/camera_model.h"
#include "core/image.h"
#include "core/result.h"

namespace gnathion {

struct StereoOptions {
  double near_mm = 300, far_mm = 600;    ///< depth along the rectified axis that is searched
  int match_block_px = 5;                ///< of the semi-global matching; odd
  int refine_radius_px = 4;              ///< window of the sub-pixel refinement: 2r+1, Gaussian
  int step_px = 2;                       ///< a vertex every so many pixels
  double left_right_px = 1.0;            ///< matched from either side, disparities agree this well
  double min_correlation = 0.75;         ///< of the two windows after refinement
  double max_disparity_sigma_px = 0.35;  ///< less certain pixels are dropped
  int speckle_px = 400;                  ///< islands of disparity smaller than this are dropped
  GridMeshOptions mesh;
};

/// What the matching says about itself.
struct StereoReport {
  double baseline_mm = 0, focal_px = 0;
  int width_px = 0, height_px = 0, disparities = 0;  ///< of the rectified pair
  double matched_share = 0;                          ///< of the rectified pixels that both cameras see
  double disparity_sigma_px = 0;                     ///< median, 1σ
  double row_shift_px = 0;  ///< median vertical shift between the images: 0 for a rig in calibration
  std::vector<std::string> warnings;
};

struct StereoSurface {
  ScanSurface surface;  ///< in the rig's frame, grey vertex colours of the first camera
  StereoReport report;
};

/// Rectifies along the baseline (whatever its direction in the image), matches semi-globally (OpenCV's SGBM,
/// left-right check, speckles removed), refines each disparity by least squares over a slanted window, and
/// triangulates: z = f·b/d, σ_z = z²·σ_d/(f·b), σ_d from each window's own residual and gradient.
/// Deterministic on any number of threads. Errors (kInput): images of another size than the rig says; a
/// baseline that is none; hardly any match (smooth skin has nothing to match: says what helps).
Result<StereoSurface> stereo_surface(const Image8& first, const Image8& second, const RigCamera& first_camera,
                                     const RigCamera& second_camera, const StereoOptions& options);

}  // namespace gnathion
