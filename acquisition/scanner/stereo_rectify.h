// A pair of cameras seen as one that was shifted sideways: the same point stands on the same row.
#pragma once

#include <vector>

#include "core/camera_model.h"
#include "core/image.h"
#include "core/result.h"

namespace gnathion {

/// Rectified pixel (u, v) of the first image looks along ((u−cx)/f, (v−cy)/f, 1); its point at depth z stands
/// in the second image at u − (f·b/z − shift). Both rectified images have the same size.
struct Rectification {
  double focal_px = 0, baseline_mm = 0, cx_px = 0, cy_px = 0, shift_px = 0;
  int width_px = 0, height_px = 0;
  Rigid3 rig_from_rectified;
  Matrix3 rectified_from_first, rectified_from_second;
  double disparity_at(double z_mm) const { return focal_px * baseline_mm / z_mm - shift_px; }
  double depth_at(double disparity_px) const { return focal_px * baseline_mm / (disparity_px + shift_px); }
};

Result<Rectification> rectify(const RigCamera& first, const RigCamera& second, double near_mm, double far_mm);

/// A grey image in single precision, with what of it the camera really saw.
struct FloatImage {
  int width_px = 0, height_px = 0;
  std::vector<float> pixels;
  std::vector<std::uint8_t> seen;
  std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_px) + static_cast<std::size_t>(x);
  }
};

/// `shift_px` is 0 for the first image, the rectification's for the second. Cubic interpolation.
FloatImage rectified(const Image8& image, const CameraModel& camera, const Matrix3& rectified_from_camera,
                     const Rectification& r, double shift_px);

}  // namespace gnathion
