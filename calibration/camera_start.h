// Where the calibration of a camera starts: focal length and poses in closed form. Internal.
#pragma once

#include "calibration/camera_problem.h"

namespace gnathion::camera_problem {

/// Intrinsics of one camera (no distortion but what a short solution finds) and rig_from_board of each of its
/// views, the camera taken as the rig. Zhang (2000) with the principal point in the middle and square pixels;
/// where views without tilt leave that open, the best of some usual focal lengths. Nothing where no start
/// leads anywhere.
std::optional<State> start_camera(const std::vector<BoardPoint>& points, const std::vector<View>& views,
                                  int width_px, int height_px, bool free_k3);

/// Pose of a flat board in one view, of the two that a plane allows the better one; nothing where its corners
/// allow none.
std::optional<Rigid3> start_pose(const Problem& problem, const State& state, const View& view);

}  // namespace gnathion::camera_problem
