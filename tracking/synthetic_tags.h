// Images of tags with exact corners, for this module's tests: super-sampled, blurred by the box of the pixel
// and a Gaussian, moved during exposure, with noise. Independent of the edge model that the fits use.
#pragma once

#include <vector>

#include "core/camera_model.h"
#include "core/image.h"
#include "core/random.h"
#include "tracking/tag_detector.h"
#include "tracking/tag_family.h"

namespace gnathion::testing {

struct SceneTag {
  int id = 0;
  double side_mm = 20;
  Rigid3 camera_from_tag;  ///< tag's plane z = 0, x right, y up on the print, z toward the viewer; centre 0
};

struct SceneLook {
  double black_grey = 40, white_grey = 190, background_grey = 110;
  double noise_grey = 2.0, psf_px = 0.6;
  Eigen::Vector2d motion_px = Eigen::Vector2d::Zero();  ///< length of the smear during exposure
  double vignetting = 0.15;                             ///< loss of light at the image's corner
  int oversampling = 6;
};

inline std::array<Vector3, 4> tag_corners_mm(double side_mm) {
  const double h = side_mm / 2;
  return {Vector3(-h, -h, 0), Vector3(h, -h, 0), Vector3(h, h, 0), Vector3(-h, h, 0)};
}

inline TagCorners true_corners(const CameraModel& camera, const SceneTag& tag) {
  TagCorners corners;
  const auto local = tag_corners_mm(tag.side_mm);
  for (std::size_t k = 0; k < 4; ++k) corners[k] = *camera.project(tag.camera_from_tag * local[k]);
  return corners;
}

/// Paints each tag's neighbourhood by casting rays: every super-sample is undistorted and meets the tag's
/// plane.
Image8 render_tags(const CameraModel& camera, const TagFamily& family, const std::vector<SceneTag>& tags,
                   const SceneLook& look, Random& random);

/// A pose with its normal tilted `tilt_rad` from the line of sight, anywhere in the image.
Rigid3 random_tag_pose(const CameraModel& camera, double distance_mm, double tilt_rad, double image_margin_px,
                       Random& random);

}  // namespace gnathion::testing
