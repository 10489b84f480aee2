#include "acquisition/scanner/stereo_surface.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "acquisition/scanner/stereo_match.h"
#include "acquisition/scanner/stereo_rectify.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot scan by stereo";
constexpr double kLeastMatched = 0.02;     // of the overlap: below it there is no face
constexpr double kMostDisparities = 1024;  // beyond it a scan takes minutes
constexpr double kRowShiftWarning_px = 0.4;

Status check_image(const Image8& image, const RigCamera& camera) {
  if (image.width_px == camera.model.width_px && image.height_px == camera.model.height_px &&
      image.pixels.size() ==
          static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px))
    return {};
  return bad_input(
      kWhat, camera.name,
      fmt::format("its image has {}x{} pixels, the rig was calibrated with {}x{}", image.width_px,
                  image.height_px, camera.model.width_px, camera.model.height_px));
}

Status check_options(const StereoOptions& o) {
  const bool good = o.near_mm > 0 && o.far_mm > o.near_mm && o.match_block_px >= 1 &&
                    o.match_block_px % 2 == 1 && o.refine_radius_px >= 2 && o.refine_radius_px <= 20 &&
                    o.step_px >= 1 && o.step_px <= 16;
  if (good) return {};
  return fail(ErrorCode::kUsage, kWhat, "options",
              "near < far, an odd block, a radius of 2 to 20 px, a step of 1 to 16 px");
}

double median(std::vector<float> values) {
  const auto middle = values.begin() + static_cast<long>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return static_cast<double>(*middle);
}

/// Depth and its sigma of the refined disparities; grey of the first image.
DepthGrid grid_from(const DisparityImage& disparity, const FloatImage& first, const Rectification& r,
                    const StereoOptions& options) {
  DepthGrid grid;
  grid.width_px = disparity.width_px;
  grid.height_px = disparity.height_px;
  grid.fx_px = grid.fy_px = r.focal_px / options.step_px;
  grid.cx_px = r.cx_px / options.step_px;
  grid.cy_px = r.cy_px / options.step_px;
  const std::size_t pixels = disparity.disparity_px.size();
  grid.depth_mm.assign(pixels, 0);
  grid.sigma_mm.assign(pixels, 0);
  grid.grey.assign(pixels, 0);
  for (int y = 0; y < grid.height_px; ++y)
    for (int x = 0; x < grid.width_px; ++x) {
      const std::size_t i = grid.at(x, y);
      const float light = first.pixels[first.at(x * options.step_px, y * options.step_px)];
      grid.grey[i] = static_cast<std::uint8_t>(std::clamp(std::lround(light), 0l, 255l));
      if (std::isnan(disparity.disparity_px[i])) continue;
      const double z = r.depth_at(static_cast<double>(disparity.disparity_px[i]));
      if (!(z >= options.near_mm && z <= options.far_mm)) continue;
      grid.depth_mm[i] = static_cast<float>(z);
      grid.sigma_mm[i] = static_cast<float>(z * z * static_cast<double>(disparity.sigma_px[i]) /
                                            (r.focal_px * r.baseline_mm));
    }
  return grid;
}

double share_matched(const DisparityImage& refined, const FloatImage& first, int step) {
  std::size_t seen = 0, matched = 0;
  for (int y = 0; y < refined.height_px; ++y)
    for (int x = 0; x < refined.width_px; ++x) {
      seen += first.seen[first.at(x * step, y * step)];
      const std::size_t i = static_cast<std::size_t>(y) * static_cast<std::size_t>(refined.width_px) +
                            static_cast<std::size_t>(x);
      matched += std::isnan(refined.disparity_px[i]) ? 0 : 1;
    }
  return seen ? static_cast<double>(matched) / static_cast<double>(seen) : 0.0;
}

}  // namespace

Result<StereoSurface> stereo_surface(const Image8& first, const Image8& second, const RigCamera& first_camera,
                                     const RigCamera& second_camera, const StereoOptions& options) {
  GNATHION_CHECK_OK(check_options(options));
  GNATHION_CHECK_OK(check_image(first, first_camera));
  GNATHION_CHECK_OK(check_image(second, second_camera));
  GNATHION_TRY(const Rectification r, rectify(first_camera, second_camera, options.near_mm, options.far_mm));
  const std::string where = first_camera.name + " and " + second_camera.name;
  const double disparities = r.disparity_at(options.near_mm) - r.disparity_at(options.far_mm);
  if (disparities > kMostDisparities)
    return bad_input(
        kWhat, where,
        fmt::format("{:.0f} disparities between {:.0f} and {:.0f} mm, {:.0f} at most: narrow the depth "
                    "range to where the face is",
                    disparities, options.near_mm, options.far_mm, kMostDisparities));
  StereoSurface out;
  out.report.baseline_mm = r.baseline_mm;
  out.report.focal_px = r.focal_px;
  out.report.width_px = r.width_px;
  out.report.height_px = r.height_px;
  try {
    const FloatImage left = rectified(first, first_camera.model, r.rectified_from_first, r, 0);
    const FloatImage right = rectified(second, second_camera.model, r.rectified_from_second, r, r.shift_px);
    const DisparityImage coarse = match_semi_globally(left, right, r, options, &out.report.disparities);
    DisparityImage fine = refined(left, right, coarse, options);
    trim_rims(fine);
    out.report.row_shift_px = median_row_shift_px(left, right, fine, options.step_px);
    out.report.matched_share = share_matched(fine, left, options.step_px);
    if (out.report.matched_share < kLeastMatched)
      return bad_input(
          kWhat, where,
          fmt::format(
              "only {:.1f} % of the picture matches between {:.0f} and {:.0f} mm: smooth "
              "skin needs a projected pattern or make-up dots, both cameras the same light and a valid "
              "calibration",
              100 * out.report.matched_share, options.near_mm, options.far_mm));
    std::vector<float> sigmas;
    for (const float s : fine.sigma_px)
      if (!std::isnan(s)) sigmas.push_back(s);
    out.report.disparity_sigma_px = median(std::move(sigmas));
    out.surface = surface_from_grid(grid_from(fine, left, r, options), r.rig_from_rectified, options.mesh);
  } catch (const cv::Exception& e) {
    return fail(ErrorCode::kInternal, kWhat, where, e.what());
  }
  if (out.surface.mesh.empty()) return bad_input(kWhat, where, "what matches holds together nowhere");
  if (std::abs(out.report.row_shift_px) > kRowShiftWarning_px)
    out.report.warnings.push_back(
        fmt::format("the images are {:.2f} px apart in height: the rig has moved since its calibration; "
                    "calibrate it again",
                    out.report.row_shift_px));
  return out;
}

}  // namespace gnathion
