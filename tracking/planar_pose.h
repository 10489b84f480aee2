// The two poses that one square tag allows.
#pragma once

#include <vector>

#include "core/camera_model.h"
#include "tracking/tag_detector.h"

namespace gnathion {

/// camera_from_body from the four corners of one tag, best reprojection first; none when the corners allow
/// none. (Collins & Bartoli 2014, infinitesimal plane-based pose, through OpenCV.)
std::vector<Rigid3> planar_poses(const CameraModel& camera, const BodyTag& tag, const TagCorners& corners_px);

}  // namespace gnathion
