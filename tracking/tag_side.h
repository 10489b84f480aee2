// One side of a tag in an image, before its edge is fitted: geometry, expected bits, rough place of the edge.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "core/camera_model.h"
#include "core/image.h"
#include "tracking/tag_detector.h"
#include "tracking/tag_family.h"

namespace gnathion {

using Vector2 = Eigen::Vector2d;

/// Cumulative normal distribution, by table with linear interpolation (error below 4e-6).
class NormalTable {
 public:
  NormalTable() {
    for (int i = 0; i <= kSize; ++i) {
      const double z = -kRange + i / kPerUnit;
      cumulative_[static_cast<std::size_t>(i)] = 0.5 * std::erfc(-z * M_SQRT1_2);
      density_[static_cast<std::size_t>(i)] = std::exp(-0.5 * z * z) * 0.3989422804014327;
    }
  }
  double cumulative(double z) const { return at(cumulative_, z); }
  double density(double z) const { return at(density_, z); }

 private:
  static constexpr double kRange = 5.0, kPerUnit = 128.0;
  static constexpr int kSize = 1280;
  using Table = std::array<double, kSize + 2>;
  static double at(const Table& table, double z) {
    const double position = (std::clamp(z, -kRange, kRange) + kRange) * kPerUnit;
    const int i = static_cast<int>(position);
    const double f = position - i;
    const std::size_t k = static_cast<std::size_t>(i);
    return table[k] * (1 - f) + table[k + 1] * f;
  }
  Table cumulative_{}, density_{};
};
inline const NormalTable kNormal;

/// Grey value between pixels, bilinear; `p` lies inside.
inline double sample(const Image8& image, const Vector2& p) {
  const int x = static_cast<int>(p.x()), y = static_cast<int>(p.y());
  const double fx = p.x() - x, fy = p.y() - y;
  const std::uint8_t* row =
      &image.pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width_px) +
                    static_cast<std::size_t>(x)];
  const std::uint8_t* next = row + image.width_px;
  return (1 - fy) * ((1 - fx) * row[0] + fx * row[1]) + fy * ((1 - fx) * next[0] + fx * next[1]);
}

inline bool inside(const Image8& image, const Vector2& p, double margin_px) {
  return p.x() >= margin_px && p.y() >= margin_px && p.x() <= image.width_px - 1 - margin_px - 1e-9 &&
         p.y() <= image.height_px - 1 - margin_px - 1e-9;
}

/// Cells of a tag to pixels.
inline Vector2 apply(const Matrix3& h, double x, double y) {
  return (h * Vector3(x, y, 1)).hnormalized();
}

/// A side between two corners, with all that is known of it before its fit.
struct Side {
  Vector2 start, along, normal;  ///< `normal` points outward (to the white margin)
  double length_px = 0, sagitta_px = 0;
  double in0 = 0, in1 = 0, out0 = 0, out1 = 0;  ///< width of the cell inside and outside, at u = 0 and 1, px

  double cell_in(double u) const { return in0 + (in1 - in0) * u; }
  double cell_out(double u) const { return out0 + (out1 - out0) * u; }
  double least_cell() const { return std::min(std::min(in0, in1), std::min(out0, out1)); }
  /// Distance outward from the side as it is assumed, sagitta included.
  double distance(const Vector2& p, double* u) const {
    const Vector2 q = p - start;
    *u = along.dot(q) / length_px;
    return normal.dot(q) - 4 * sagitta_px * *u * (1 - *u);
  }
};

/// White runs of the first row of data cells along a side: from and to, px along it.
struct InnerRow {
  static constexpr int kMostRuns = 8;
  std::array<double, kMostRuns> from_px{}, to_px{};
  int runs = 0;
  /// How white the row is at `s` px along the side, blurred along it.
  double white(double s_px, double blur_px) const;
};
InnerRow inner_row(const Side& side, const Matrix3& h, const TagFamily& family, int id, int k);

/// The four sides of a quad, side k from corner k to the next; `h` maps cells to pixels. False when one is
/// too short.
bool make_sides(const CameraModel& camera, const TagFamily& family, const TagCorners& corners,
                const Matrix3& h, std::array<Side, 4>* sides);

/// Offset a and slope b of the strongest dark-to-bright edge, by profiles across the side.
bool find_edge(const Image8& image, const Side& side, double* offset, double* slope);

}  // namespace gnathion
