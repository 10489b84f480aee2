#include "acquisition/scanner/stereo_rectify.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot rectify stereo pair";

/// What a camera sees, in tangents of the rectified frame.
struct Extent {
  double x0 = 1e9, x1 = -1e9, y0 = 1e9, y1 = -1e9;
  bool behind = false;  ///< a border ray does not look forward
};

Extent extent_of(const CameraModel& camera, const Matrix3& rectified_from_camera) {
  Extent e;
  const auto include = [&](double u, double v) {
    const Eigen::Vector2d n = camera.undistorted({u, v});
    const Vector3 ray = rectified_from_camera * Vector3(n.x(), n.y(), 1);
    if (ray.z() < 0.2 * ray.norm()) {
      e.behind = true;
      return;
    }
    e.x0 = std::min(e.x0, ray.x() / ray.z());
    e.x1 = std::max(e.x1, ray.x() / ray.z());
    e.y0 = std::min(e.y0, ray.y() / ray.z());
    e.y1 = std::max(e.y1, ray.y() / ray.z());
  };
  for (int i = 0; i <= 16; ++i) {
    const double u = (camera.width_px - 1) * i / 16.0, v = (camera.height_px - 1) * i / 16.0;
    include(u, 0);
    include(u, camera.height_px - 1);
    include(0, v);
    include(camera.width_px - 1, v);
  }
  return e;
}

}  // namespace

Result<Rectification> rectify(const RigCamera& first, const RigCamera& second, double near_mm,
                              double far_mm) {
  const std::string where = first.name + " and " + second.name;
  const Rigid3 first_from_second = first.rig_from_camera.inverse() * second.rig_from_camera;
  Rectification r;
  r.baseline_mm = first_from_second.translation_mm.norm();
  if (r.baseline_mm < 5)
    return bad_input(
        kWhat, where,
        fmt::format("the cameras are {:.2f} mm apart; depth needs a baseline (a tenth to a third "
                    "of the distance to the face)",
                    r.baseline_mm));
  const Vector3 x = first_from_second.translation_mm / r.baseline_mm;
  Vector3 z = Vector3::UnitZ() + first_from_second.rotation.col(2);
  z -= z.dot(x) * x;
  if (z.norm() < 0.3) return bad_input(kWhat, where, "the cameras look along their baseline or apart");
  z.normalize();
  r.rectified_from_first.row(0) = x.transpose();
  r.rectified_from_first.row(1) = z.cross(x).transpose();
  r.rectified_from_first.row(2) = z.transpose();
  r.rectified_from_second = r.rectified_from_first * first_from_second.rotation;
  r.rig_from_rectified = first.rig_from_camera * Rigid3{r.rectified_from_first.transpose(), Vector3::Zero()};

  const Extent a = extent_of(first.model, r.rectified_from_first),
               b = extent_of(second.model, r.rectified_from_second);
  const double y0 = std::max(a.y0, b.y0), y1 = std::min(a.y1, b.y1);
  // What the second camera sees at the searched depths, as the first one sees it.
  const double x0 = std::max(a.x0, b.x0 + r.baseline_mm / far_mm),
               x1 = std::min(a.x1, b.x1 + r.baseline_mm / near_mm);
  if (a.behind || b.behind || !(y1 > y0) || !(x1 > x0))
    return bad_input(
        kWhat, where,
        fmt::format("the cameras' views do not overlap between {:.0f} and {:.0f} mm", near_mm, far_mm));
  r.focal_px = 0.25 * (first.model.fx_px + first.model.fy_px + second.model.fx_px + second.model.fy_px);
  r.width_px = static_cast<int>(std::ceil((x1 - x0) * r.focal_px)) + 1;
  r.height_px = static_cast<int>(std::ceil((y1 - y0) * r.focal_px)) + 1;
  r.cx_px = -x0 * r.focal_px;
  r.cy_px = -y0 * r.focal_px;
  r.shift_px = 0.5 * r.focal_px * r.baseline_mm * (1 / near_mm + 1 / far_mm);
  const auto pixels = [](const CameraModel& m) { return static_cast<double>(m.width_px) * m.height_px; };
  if (static_cast<double>(r.width_px) * r.height_px > 3 * std::max(pixels(first.model), pixels(second.model)))
    return bad_input(kWhat, where, "the cameras are turned too far towards each other");
  return r;
}

FloatImage rectified(const Image8& image, const CameraModel& camera, const Matrix3& rectified_from_camera,
                     const Rectification& r, double shift_px) {
  const Matrix3 camera_from_rectified = rectified_from_camera.transpose();
  // Beyond the image's corners the distortion's polynomial may fold back into it.
  double farthest2 = 0;
  for (const double u : {0.0, camera.width_px - 1.0})
    for (const double v : {0.0, camera.height_px - 1.0})
      farthest2 = std::max(farthest2, camera.undistorted({u, v}).squaredNorm());
  cv::Mat map_x(r.height_px, r.width_px, CV_32F), map_y(r.height_px, r.width_px, CV_32F);
  FloatImage out;
  out.width_px = r.width_px;
  out.height_px = r.height_px;
  out.seen.assign(static_cast<std::size_t>(r.width_px) * static_cast<std::size_t>(r.height_px), 0);
  for (int v = 0; v < r.height_px; ++v)
    for (int u = 0; u < r.width_px; ++u) {
      const Vector3 ray((u - shift_px - r.cx_px) / r.focal_px, (v - r.cy_px) / r.focal_px, 1);
      const Vector3 p = camera_from_rectified * ray;
      const auto pixel = camera.project(p);
      const bool in_view = pixel && p.head<2>().squaredNorm() <= 1.02 * farthest2 * p.z() * p.z();
      const bool seen = in_view && pixel->x() >= 1 && pixel->y() >= 1 && pixel->x() <= camera.width_px - 2 &&
                        pixel->y() <= camera.height_px - 2;
      out.seen[out.at(u, v)] = seen ? 1 : 0;
      map_x.at<float>(v, u) = seen ? static_cast<float>(pixel->x()) : -10.0f;
      map_y.at<float>(v, u) = seen ? static_cast<float>(pixel->y()) : -10.0f;
    }
  const cv::Mat source(image.height_px, image.width_px, CV_8U,
                       const_cast<std::uint8_t*>(image.pixels.data()));
  cv::Mat grey, warped;
  source.convertTo(grey, CV_32F);
  cv::remap(grey, warped, map_x, map_y, cv::INTER_LANCZOS4, cv::BORDER_REPLICATE);
  out.pixels.assign(warped.ptr<float>(), warped.ptr<float>() + warped.total());
  return out;
}

}  // namespace gnathion
