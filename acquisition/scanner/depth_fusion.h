// A burst of depth frames of something that stands still, to one surface.
#pragma once

#include <string>
#include <vector>

#include "acquisition/scanner/depth_grid.h"
#include "acquisition/scanner/depth_protocol.h"
#include "core/camera_model.h"
#include "core/result.h"

namespace gnathion {

struct DepthFusionOptions {
  double unit_mm = 1.0;  ///< of one count
  double near_mm = 150, far_mm = 900;
  double least_share = 0.6;  ///< of the frames in which a pixel must have been measured
  double flying_mm = 8.0;    ///< a pixel that stands this far off most of its neighbours flies
};

struct FusedDepth {
  DepthGrid grid;
  int frames = 0;
  double invalid_share = 0;  ///< of the pixels
  double flying_share = 0;
  double frame_sigma_mm = 0;  ///< median 1σ of a single measurement
};

/// Per pixel: median, spread by median absolute deviation, mean of what lies within three of them; the
/// deviation is that mean's standard error, but never below the unit's rounding. Error (kInput): frames of
/// several sizes, not the camera's size, fewer than three, nothing in range.
Result<FusedDepth> fuse_depth(const std::vector<DepthImage>& frames, const CameraModel& camera,
                              const DepthFusionOptions& options);

}  // namespace gnathion
