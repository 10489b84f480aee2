// Images of calibration boards with known truth: each pixel integrates the print over its square, seen
// through the lens. Independent of the detector: patterns from OpenCV's and libapriltag's own tables, no edge
// model.
#pragma once

#include <cmath>
#include <map>
#include <memory>
#include <vector>

#include <opencv2/aruco.hpp>

#include "core/calibration_board.h"
#include "core/camera_model.h"
#include "core/image.h"
#include "core/random.h"
#include "tracking/tag_family.h"

namespace gnathion::testing {

/// What is printed where on a board (mm in its frame): 1 white, 0 black.
class PrintedBoard {
 public:
  explicit PrintedBoard(const CalibrationBoard& board, bool corner_squares = true)
      : board_(board), corner_squares_(corner_squares), family_(*TagFamily::load("tag36h11")) {
    if (board.kind != BoardKind::kCharuco) return;
    static const std::map<std::string, int> ids = {{"4X4_50", cv::aruco::DICT_4X4_50},
                                                   {"5X5_100", cv::aruco::DICT_5X5_100}};
    const auto dictionary = cv::aruco::getPredefinedDictionary(ids.at(board.family));
    cells_ = dictionary->markerSize + 2;
    for (int id = 0; id < 40; ++id) {
      cv::Mat image;
      dictionary->drawMarker(id, cells_, image, 1);
      markers_.push_back(image);
    }
  }

  double white(double x, double y) const {
    const double s = board_.square_mm;
    if (board_.kind == BoardKind::kAprilGrid) return april(x, y);
    const bool charuco = board_.kind == BoardKind::kCharuco;
    const int columns = board_.columns + (charuco ? 0 : 1), rows = board_.rows + (charuco ? 0 : 1);
    const int c = static_cast<int>(std::floor(x / s)) + 1, r = static_cast<int>(std::floor(y / s)) + 1;
    if (c < 0 || r < 0 || c >= columns || r >= rows) return 1;
    if ((c + r) % 2 == 0) return 0;  // the upper left square is black
    if (!charuco) return 1;
    const double m = board_.marker_mm, margin = (s - m) / 2;
    const double u = (x - (c - 1) * s - margin) / m, v = (y - (r - 1) * s - margin) / m;
    if (u < 0 || v < 0 || u >= 1 || v >= 1) return 1;
    int id = 0;
    for (int i = 0; i < r * columns + c; ++i) id += (i / columns + i % columns) % 2;
    const cv::Mat& image = markers_[static_cast<std::size_t>(id)];
    return image.at<std::uint8_t>(static_cast<int>(v * cells_), static_cast<int>(u * cells_)) > 0 ? 1 : 0;
  }

 private:
  double april(double x, double y) const {
    const double s = board_.square_mm, gap = board_.gap * s, pitch = s + gap;
    const double up = -y;  // tag 0 is the lower left one
    const int c = static_cast<int>(std::floor(x / pitch)), r = static_cast<int>(std::floor(up / pitch));
    const double u = x - c * pitch, v = up - r * pitch;
    if (c >= 0 && r >= 0 && c < board_.columns && r < board_.rows && u < s && v < s) {
      const int n = family_.square_cells();
      const int cx = static_cast<int>(u / s * n), cy = n - 1 - static_cast<int>(v / s * n);
      return family_.white(r * board_.columns + c, cx, cy) ? 1 : 0;
    }
    // Squares that touch the tags at their corners.
    const bool square =
        corner_squares_ && u >= s && v >= s && c >= -1 && r >= -1 && c < board_.columns && r < board_.rows;
    return square ? 0 : 1;
  }

  CalibrationBoard board_;
  bool corner_squares_;
  TagFamily family_;
  int cells_ = 0;
  std::vector<cv::Mat> markers_;
};

struct BoardLook {
  double black_grey = 35, white_grey = 205, noise_grey = 2, blur_px = 0.7;
};

/// Undistorted rays at the corners of pixels, once for a camera.
class RayGrid {
 public:
  explicit RayGrid(const CameraModel& camera) : width_(camera.width_px + 1) {
    for (int y = 0; y <= camera.height_px; ++y)
      for (int x = 0; x <= camera.width_px; ++x) rays_.push_back(camera.undistorted({x - 0.5, y - 0.5}));
  }
  Eigen::Vector2d at(int x, int y) const { return rays_[static_cast<std::size_t>(y * width_ + x)]; }

 private:
  int width_;
  std::vector<Eigen::Vector2d> rays_;
};

inline Image8 render_board(const PrintedBoard& print, const CameraModel& camera, const RayGrid& rays,
                           const Rigid3& camera_from_board, const BoardLook& look, Random& random) {
  const Rigid3 inverse = camera_from_board.inverse();
  const Vector3 eye = inverse.translation_mm;
  const auto white_at = [&](const Eigen::Vector2d& ray) {
    const Vector3 direction = inverse.rotation * Vector3(ray.x(), ray.y(), 1);
    const double t = -eye.z() / direction.z();
    return t > 0 ? print.white(eye.x() + t * direction.x(), eye.y() + t * direction.y()) : 1.0;
  };
  const int w = camera.width_px, h = camera.height_px;
  std::vector<double> corner(static_cast<std::size_t>((w + 1) * (h + 1)));
  for (int y = 0; y <= h; ++y)
    for (int x = 0; x <= w; ++x) corner[static_cast<std::size_t>(y * (w + 1) + x)] = white_at(rays.at(x, y));
  std::vector<double> light(static_cast<std::size_t>(w * h));
  constexpr int kSub = 8;
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const double* k = &corner[static_cast<std::size_t>(y * (w + 1) + x)];
      double sum = k[0];
      if (k[0] != k[1] || k[0] != k[w + 1] || k[0] != k[w + 2]) {
        sum = 0;
        const Eigen::Vector2d a = rays.at(x, y), b = rays.at(x + 1, y), c = rays.at(x, y + 1),
                              d = rays.at(x + 1, y + 1);
        for (int j = 0; j < kSub; ++j)
          for (int i = 0; i < kSub; ++i) {
            const double u = (i + 0.5) / kSub, v = (j + 0.5) / kSub;
            sum += white_at((1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * c + u * d)) / (kSub * kSub);
          }
      }
      light[static_cast<std::size_t>(y * w + x)] =
          look.black_grey + (look.white_grey - look.black_grey) * sum;
    }
  // The lens's blur, then noise and rounding.
  const int reach = static_cast<int>(std::ceil(3.5 * look.blur_px));
  std::vector<double> kernel;
  double total = 0;
  for (int i = -reach; i <= reach; ++i)
    kernel.push_back(std::exp(-0.5 * i * i / (look.blur_px * look.blur_px))), total += kernel.back();
  const auto pass = [&](const std::vector<double>& in, int dx, int dy) {
    std::vector<double> out(in.size());
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x) {
        double sum = 0;
        for (int i = -reach; i <= reach; ++i) {
          const int xx = std::clamp(x + i * dx, 0, w - 1), yy = std::clamp(y + i * dy, 0, h - 1);
          sum += kernel[static_cast<std::size_t>(i + reach)] * in[static_cast<std::size_t>(yy * w + xx)];
        }
        out[static_cast<std::size_t>(y * w + x)] = sum / total;
      }
    return out;
  };
  light = pass(pass(light, 1, 0), 0, 1);
  Image8 image(w, h);
  for (std::size_t i = 0; i < light.size(); ++i)
    image.pixels[i] = static_cast<std::uint8_t>(
        std::clamp(std::lround(light[i] + look.noise_grey * random.normal()), 0l, 255l));
  return image;
}

/// The board before the camera, tilted to any side by up to `tilt_rad`, filling about `share` of the image's
/// width.
inline Rigid3 held_board(const CalibrationBoard& board, const CameraModel& camera, double tilt_rad,
                         double share, Random& random) {
  Vector3 low = board.points_mm().front(), high = low;
  for (const Vector3& p : board.points_mm()) low = low.cwiseMin(p), high = high.cwiseMax(p);
  const Vector3 middle = 0.5 * (low + high);
  const double z = (high - low).x() * camera.fx_px / (share * random.uniform(0.75, 1.15) * camera.width_px);
  const double phi = random.uniform(0, 2 * M_PI);
  const Matrix3 turn = exp_so3(random.uniform(0.4, 1) * tilt_rad * Vector3(std::cos(phi), std::sin(phi), 0)) *
                       exp_so3(Vector3(0, 0, random.uniform(-0.3, 0.3)));
  const double x = random.uniform(-0.24, 0.24) * camera.width_px / camera.fx_px * z;
  const double y = random.uniform(-0.18, 0.18) * camera.height_px / camera.fy_px * z;
  return {turn, Vector3(x, y, z) - turn * middle};
}

}  // namespace gnathion::testing
