// Two images of one moment and the rig that took them, to a surface with deviations.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "acquisition/scanner/scan_ply.h"
#include "core/camera_model.h"
#include "core/image.h"
#include "core/result.h"

namespace gnathion {

struct StereoOptions {
  double near_mm = 250, far_mm = 700;  ///< depth that is searched
  int match_block_px = 5;              ///< of the semi-global matching
  int refine_radius_px = 5;            ///< window of the sub-pixel refinement: 2r+1
  double left_right_px = 1.0;          ///< the two directions must agree this well
  double min_texture = 2.0;            ///< grey levels rms in the refinement's window
  double max_disparity_sigma_px = 0.3;
  int speckle_px = 300;  ///< smaller islands of disparity are dropped
};

/// What the matching says about itself.
struct StereoReport {
  double baseline_mm = 0, focal_px = 0;
  int width_px = 0, height_px = 0, disparities = 0;  ///< of the rectified pair
  double matched_share = 0;                          ///< of the first image's pixels
  double disparity_sigma_px = 0;                     ///< median, 1σ
  double row_error_px = 0;  ///< median vertical shift between the images: a rig out of calibration
  std::vector<std::string> warnings;
};

struct StereoSurface {
  ScanSurface surface;  ///< in the rig's frame, grey vertex colours
  StereoReport report;
};

/// Rectifies along the baseline, matches semi-globally in both directions, refines by least squares, rejects
/// what does not agree, triangulates. σ_z = z²·σ_d/(f·b) with σ_d from each window's own residual and
/// gradient. Deterministic on any number of threads. Errors (kInput): images of another size than the rig
/// says, a baseline that is none, hardly any match (smooth skin needs projected texture: says so).
Result<StereoSurface> stereo_surface(const Image8& first, const Image8& second, const RigCamera& first_camera,
                                     const RigCamera& second_camera, const StereoOptions& options);

}  // namespace gnathion
