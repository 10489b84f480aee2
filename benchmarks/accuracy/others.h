// What others make of the same pictures: OpenCV's ArUco detector with the AprilTag dictionary, and solvePnP.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/camera_model.h"
#include "core/image.h"
#include "tracking/body_pose.h"
#include "tracking/tag_detector.h"

namespace gnathion::accuracy {

enum class ArucoRefinement { kNone, kSubpixel, kContour, kAprilTag };

/// Tags by cv::aruco::detectMarkers (DICT_APRILTAG_36h11), one thread; corners in our order.
std::vector<TagObservation> aruco_tags(const Image8& image, ArucoRefinement refinement);

enum class PnpMethod { kIterative, kIppeLargestTag };

/// camera_from_body by cv::solvePnP from all corners (iterative, started by EPnP), or from the largest tag's
/// (IPPE, the solution with the smaller residual).
std::optional<Rigid3> pnp_pose(const CameraModel& camera, const TaggedBody& body,
                               const std::vector<TagObservation>& tags, PnpMethod method);

}  // namespace gnathion::accuracy
