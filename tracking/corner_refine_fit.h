// The grey values along one side of a tag, and the edge fitted to them (the model: corner_refine.h).
#pragma once

#include <array>

#include "core/image.h"
#include "tracking/tag_side.h"

namespace gnathion {

constexpr int kEdgeParameters = 7;  // a, b, σ, B, B', C, C'
constexpr int kEdgeSegments = 8;    // pieces of a side that are judged, and left out, by themselves

/// An edge as fitted. Start values: offset and slope 0, blur, levels from the strip.
struct EdgeFit {
  Eigen::Matrix<double, kEdgeParameters, 1> x = Eigen::Matrix<double, kEdgeParameters, 1>::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  ///< of a, b
  double noise_grey = 0;
  double reach_px = 0;  ///< how far from the edge pixels were used
  int covered = 0;      ///< segments left out: something else lies over the edge there
  bool fitted = false;  ///< false: nothing is known of this side but where it was expected
  double blur_px() const { return x[2]; }
  double contrast_grey() const { return x[5]; }
};

/// Working memory for one strip of pixels; the fixed capacity keeps the hot loop free of allocations. A side
/// with more pixels uses every second, third, … line across it.
struct EdgeStrip {
  static constexpr int kCapacity = 2048;
  static constexpr int kGridCapacity = 2048;
  using Column = std::array<float, kCapacity>;
  alignas(16) Column grey, v, distance, cell_in, inner_white, weight, residual;
  std::array<double, kGridCapacity> white_row;
  int count = 0;
  bool inner_cells = false;  ///< the first row of data cells reaches into the strip
};

/// Cuts a strip around the side as it is assumed and fits its edge. `row` is the tag's first row of data
/// cells along the side. False when the side leaves the image, has too few pixels or does not converge.
bool fit_edge(const Image8& image, const Side& side, const InnerRow& row, double start_blur_px,
              EdgeStrip* strip, EdgeFit* fit);

}  // namespace gnathion
