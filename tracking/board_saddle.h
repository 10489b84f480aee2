// The point where two edges cross, fitted to the grey values around it.
//
//   I(p) = m + g·p + c·E(d1/σ)·E(d2/σ),  E(z) = 2Φ(z) − 1,  dk = nk·(p − x0)
// with two lines through x0. The pattern and the model are both symmetric under a half turn about x0, so
// blur, dot gain of the print, oblique view and an even gradient of light do not move the estimate.
#pragma once

#include <optional>

#include <Eigen/Core>

#include "core/image.h"

namespace gnathion {

struct Saddle {
  Eigen::Vector2d px;
  Eigen::Matrix2d covariance_px2;
  double contrast_grey =
      0;                  ///< the quadrant between +a and +b minus its neighbours: negative where it is black
  double blur_px = 0;     ///< σ
  double noise_grey = 0;  ///< RMS residual
};

/// `along_a`, `along_b`: directions of the two edges in the image (any length). Fits the pixels within
/// `radius_px` of `start`. Nothing where the disc leaves the image, the fit wanders off by more than half of
/// the radius, or what is there is not two edges that cross.
std::optional<Saddle> fit_saddle(const Image8& image, const Eigen::Vector2d& start_px,
                                 const Eigen::Vector2d& along_a, const Eigen::Vector2d& along_b,
                                 double radius_px);

}  // namespace gnathion
