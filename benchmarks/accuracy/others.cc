#include "benchmarks/accuracy/others.h"

#include <algorithm>

#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>

namespace gnathion::accuracy {
namespace {

constexpr std::size_t kCorner[] = {1, 0, 3, 2};

double area(const TagCorners& c) {
  const Eigen::Vector2d a = c[2] - c[0], b = c[3] - c[1];
  return std::abs(a.x() * b.y() - a.y() * b.x());
}

cv::Mat camera_matrix(const CameraModel& c) {
  return (cv::Mat_<double>(3, 3) << c.fx_px, 0, c.cx_px, 0, c.fy_px, c.cy_px, 0, 0, 1);
}

Rigid3 pose_of(const cv::Mat& rotation, const cv::Mat& translation) {
  const auto vector = [](const cv::Mat& m) {
    return Vector3(m.at<double>(0), m.at<double>(1), m.at<double>(2));
  };
  return {exp_so3(vector(rotation)), vector(translation)};
}

}  // namespace

std::vector<TagObservation> aruco_tags(const Image8& image, ArucoRefinement refinement) {
  cv::setNumThreads(1);
  static const cv::Ptr<cv::aruco::Dictionary> dictionary =
      cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
  cv::Ptr<cv::aruco::DetectorParameters> parameters = cv::aruco::DetectorParameters::create();
  constexpr cv::aruco::CornerRefineMethod kMethods[] = {
      cv::aruco::CORNER_REFINE_NONE, cv::aruco::CORNER_REFINE_SUBPIX, cv::aruco::CORNER_REFINE_CONTOUR,
      cv::aruco::CORNER_REFINE_APRILTAG};
  parameters->cornerRefinementMethod = kMethods[static_cast<int>(refinement)];
  const cv::Mat view(image.height_px, image.width_px, CV_8U, const_cast<std::uint8_t*>(image.pixels.data()));
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<int> ids;
  cv::aruco::detectMarkers(view, dictionary, corners, ids, parameters);
  std::vector<TagObservation> tags;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    TagObservation o;
    o.id = ids[i];
    for (std::size_t k = 0; k < 4; ++k) {
      // OpenCV's dictionary holds this family turned by half a turn, and counts from the upper left corner
      // clockwise; ours from the lower left counter-clockwise. The AprilTag refinement has its pixels' origin
      // at their corner.
      const cv::Point2f& c = corners[i][kCorner[k]];
      const double origin = refinement == ArucoRefinement::kAprilTag ? 0.5 : 0.0;
      o.corners_px[k] = {c.x - origin, c.y - origin};
    }
    tags.push_back(o);
  }
  return tags;
}

std::optional<Rigid3> pnp_pose(const CameraModel& camera, const TaggedBody& body,
                               const std::vector<TagObservation>& tags, PnpMethod method) {
  const auto tag_of = [&](int id) {
    return std::find_if(body.tags.begin(), body.tags.end(), [&](const BodyTag& t) { return t.id == id; });
  };
  std::vector<const TagObservation*> seen;
  for (const TagObservation& o : tags) {
    if (tag_of(o.id) != body.tags.end()) seen.push_back(&o);
  }
  if (seen.empty()) return std::nullopt;
  if (method == PnpMethod::kIppeLargestTag) {
    seen = {*std::max_element(seen.begin(), seen.end(), [](const TagObservation* a, const TagObservation* b) {
      return area(a->corners_px) < area(b->corners_px);
    })};
  }
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> image;
  for (const TagObservation* o : seen) {
    for (std::size_t k = 0; k < 4; ++k) {
      const Vector3& p = tag_of(o->id)->corners_in_body_mm[k];
      object.emplace_back(p.x(), p.y(), p.z());
      image.emplace_back(o->corners_px[k].x(), o->corners_px[k].y());
    }
  }
  const cv::Mat k = camera_matrix(camera);
  const std::vector<double> distortion = {camera.k1, camera.k2, camera.p1, camera.p2, camera.k3};
  cv::Mat rotation, translation;
  try {
    if (method == PnpMethod::kIterative) {
      if (!cv::solvePnP(object, image, k, distortion, rotation, translation, false, cv::SOLVEPNP_EPNP))
        return std::nullopt;
      cv::solvePnP(object, image, k, distortion, rotation, translation, true, cv::SOLVEPNP_ITERATIVE);
    } else if (!cv::solvePnP(object, image, k, distortion, rotation, translation, false, cv::SOLVEPNP_IPPE)) {
      return std::nullopt;
    }
  } catch (const cv::Exception&) {
    return std::nullopt;
  }
  return pose_of(rotation, translation);
}

}  // namespace gnathion::accuracy
