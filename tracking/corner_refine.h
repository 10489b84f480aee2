// Corners of a tag from its four edges, each fitted to the grey values of a strip along it.
//
// Model of a side, for a pixel at signed distance d outside of the edge and position u in 0..1 along it, v =
// u − ½:
//   I = B + B'v + (C + C'v)·[Φ(d/σ) + w(u)·Φ((−d − cell)/σ)],  d = n·(p − A) − 4s·u(1−u) − a − b·v
// a, b: offset and slope of the edge against its start; s: the sagitta that the lens gives a straight edge
// (known from the camera model); w: the known data bits of the first inner row of cells. Least squares over
// all pixels of the strip is the maximum-likelihood estimate under white noise, and its normal matrix the
// covariance.
#pragma once

#include <algorithm>
#include <array>
#include <optional>

#include "core/camera_model.h"
#include "core/image.h"
#include "tracking/tag_detector.h"
#include "tracking/tag_family.h"

namespace gnathion {

struct RefinedCorners {
  TagCorners corners_px;
  Matrix8 covariance_px2 = Matrix8::Zero();
  double black_grey = 0, contrast_grey = 0;  ///< mean of the sides
  double noise_grey = 0;                     ///< RMS residual, mean of the sides
  std::array<float, 4> side_blur_px = {};    ///< standard deviation of each side's profile
  std::array<bool, 4> side_fitted = {};      ///< false: covered, or lost in glare
  double covered = 0;                        ///< share of the outline that was left out
  double blur_px() const {
    return static_cast<double>(*std::max_element(side_blur_px.begin(), side_blur_px.end()));
  }
};

/// What is known before the fit.
struct CornerStart {
  TagCorners corners_px;
  /// The corners are a prediction (off by a pixel or so) and not a detector's: fitted straight away, and up
  /// to two sides may be missing; those stay where they are predicted, with a covariance that says so.
  bool predicted = false;
  std::array<float, 4> side_blur_px = {0.75f, 0.75f, 0.75f, 0.75f};  ///< of the last frame
};

struct EdgeStrip;

/// Nothing when a side has no dark-to-bright edge within about a cell (at most 7 px) of its start, is too
/// short or too noisy, leaves the image, or does not converge. `strip` is working memory.
std::optional<RefinedCorners> refine_corners(const Image8& image, const CameraModel& camera,
                                             const TagFamily& family, int id, const CornerStart& start,
                                             EdgeStrip* strip);

/// The data bits at refined corners, compared with the id's; cells along sides that were not fitted are not
/// asked.
struct BitCheck {
  int wrong = 0;
  double margin_grey = 0;  ///< mean distance from the threshold, signed: wrong bits count negative
};
BitCheck check_bits(const Image8& image, const TagFamily& family, int id, const RefinedCorners& corners);

/// Homography from cells of the black square (0..square_cells, x right, y down) to pixels, from corners in
/// the order lower left, lower right, upper right, upper left.
Matrix3 pixels_from_cells(const TagCorners& corners_px, int square_cells);

}  // namespace gnathion
