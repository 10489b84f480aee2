#include "tracking/planar_pose.h"

#include <opencv2/calib3d.hpp>

namespace gnathion {
namespace {

/// Frame of the tag's own plane: origin at its centre, x along the lower side, z toward the viewer.
Rigid3 body_from_tag(const BodyTag& tag) {
  const auto& c = tag.corners_in_body_mm;
  Rigid3 pose;
  pose.translation_mm = 0.25 * (c[0] + c[1] + c[2] + c[3]);
  const Vector3 x = (c[1] + c[2] - c[0] - c[3]).normalized();
  const Vector3 z = x.cross(Vector3(c[2] + c[3] - c[0] - c[1])).normalized();
  pose.rotation.col(0) = x;
  pose.rotation.col(1) = z.cross(x);
  pose.rotation.col(2) = z;
  return pose;
}

}  // namespace

std::vector<Rigid3> planar_poses(const CameraModel& camera, const BodyTag& tag,
                                 const TagCorners& corners_px) {
  const Rigid3 local = body_from_tag(tag);
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> image;
  for (std::size_t k = 0; k < 4; ++k) {
    const Vector3 p = local.inverse() * tag.corners_in_body_mm[k];
    object.emplace_back(p.x(), p.y(), 0.0);
    const Eigen::Vector2d n = camera.undistorted(corners_px[k]);
    if (!n.allFinite() || !p.allFinite()) return {};
    image.emplace_back(n.x(), n.y());
  }
  std::vector<cv::Mat> rotations, translations;
  try {
    cv::solvePnPGeneric(object, image, cv::Mat::eye(3, 3, CV_64F), cv::noArray(), rotations, translations,
                        false, cv::SOLVEPNP_IPPE);
  } catch (const cv::Exception&) {
    return {};  // degenerate corners have no pose
  }
  std::vector<Rigid3> poses;
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    const auto vector = [](const cv::Mat& m) {
      return Vector3(m.at<double>(0), m.at<double>(1), m.at<double>(2));
    };
    const Rigid3 camera_from_tag{exp_so3(vector(rotations[i])), vector(translations[i])};
    if (!camera_from_tag.translation_mm.allFinite() || camera_from_tag.translation_mm.z() <= 0) continue;
    poses.push_back(camera_from_tag * local.inverse());
  }
  return poses;
}

}  // namespace gnathion
