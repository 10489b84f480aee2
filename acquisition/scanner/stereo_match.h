// Which pixel of the second rectified image shows what a pixel of the first one shows.
#pragma once

#include <vector>

#include "acquisition/scanner/stereo_rectify.h"
#include "acquisition/scanner/stereo_surface.h"

namespace gnathion {

/// Disparity u1 − u2 of each pixel of the first image; NaN where there is none.
struct DisparityImage {
  int width_px = 0, height_px = 0;
  std::vector<float> disparity_px;
  std::vector<float> sigma_px;
};

/// Semi-global matching to a sixteenth of a pixel, left-right checked, speckles removed. No sigma yet.
/// `disparities` is how many were searched.
DisparityImage match_semi_globally(const FloatImage& first, const FloatImage& second, const Rectification& r,
                                   const StereoOptions& options, int* disparities);

/// Every step_px-th pixel, refined by Gauss-Newton: I1(x,y) = g·I2(x − d(x,y), y) + o over a Gaussian window,
/// d linear in x and y. The image it returns is smaller by step_px; disparities stay in rectified pixels.
DisparityImage refined(const FloatImage& first, const FloatImage& second, const DisparityImage& coarse,
                       const StereoOptions& options);

/// Takes away what borders on nothing: at rims windows reach over the edge.
void trim_rims(DisparityImage& image);

/// Median vertical shift of the second image against the first at pixels that were matched.
double median_row_shift_px(const FloatImage& first, const FloatImage& second, const DisparityImage& refined,
                           int step_px);

}  // namespace gnathion
