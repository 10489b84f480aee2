#include "acquisition/scanner/depth_fusion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot fuse depth frames";

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<long>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Status check(const std::vector<DepthImage>& frames, const CameraModel& camera) {
  if (frames.size() < 3)
    return bad_input(kWhat, "burst", fmt::format("{} frames; at least 3 are needed", frames.size()));
  for (const DepthImage& f : frames)
    if (f.width_px != camera.width_px || f.height_px != camera.height_px ||
        f.units.size() != static_cast<std::size_t>(f.width_px) * static_cast<std::size_t>(f.height_px))
      return bad_input(kWhat, "burst",
                       fmt::format("a frame of {}x{} pixels, the intrinsics are of {}x{}", f.width_px,
                                   f.height_px, camera.width_px, camera.height_px));
  if (camera.k1 != 0 || camera.k2 != 0 || camera.k3 != 0 || camera.p1 != 0 || camera.p2 != 0)
    return bad_input(kWhat, "intrinsics",
                     "depth images must be rectified: distortion other than 0 is not supported");
  return {};
}

struct Pixel {
  double depth_mm = 0, sigma_mm = 0, single_sigma_mm = 0;
};

/// Mean of the values within three robust sigmas of their median; its standard error.
Pixel fused(std::vector<double>& values, double unit_mm) {
  // Rounding to units is noise too, and the least there is.
  const double rounding = unit_mm / std::sqrt(12.0);
  const double centre = median_of(values);
  std::vector<double> off;
  for (const double v : values) off.push_back(std::abs(v - centre));
  const double spread = std::max(1.4826 * median_of(off), rounding);
  double sum = 0, squares = 0, count = 0;
  for (const double v : values) {
    if (std::abs(v - centre) > 3 * spread + 0.5 * unit_mm) continue;
    sum += v - centre;
    squares += (v - centre) * (v - centre);
    count += 1;
  }
  Pixel pixel;
  const double mean = sum / count;
  pixel.depth_mm = centre + mean;
  const double variance = count > 1 ? std::max(0.0, squares - count * mean * mean) / (count - 1) : 0.0;
  pixel.single_sigma_mm = std::max(std::sqrt(variance), rounding);
  // Below one unit all frames round alike: averaging does not help against that.
  pixel.sigma_mm = std::max(pixel.single_sigma_mm / std::sqrt(count),
                            std::sqrt(variance) < 0.4 * unit_mm ? rounding : 0.0);
  return pixel;
}

/// Pixels between two surfaces, on neither: most of their neighbours are far from them.
std::size_t remove_flying(DepthGrid& grid, double flying_mm) {
  const std::vector<float> before = grid.depth_mm;
  std::size_t removed = 0;
  for (int y = 0; y < grid.height_px; ++y)
    for (int x = 0; x < grid.width_px; ++x) {
      const float own = before[grid.at(x, y)];
      if (own <= 0) continue;
      int near = 0;
      for (int k = 0; k < 9; ++k) {
        const int nx = x + k % 3 - 1, ny = y + k / 3 - 1;
        if (k == 4 || nx < 0 || ny < 0 || nx >= grid.width_px || ny >= grid.height_px) continue;
        const float other = before[grid.at(nx, ny)];
        near += other > 0 && std::abs(other - own) <= static_cast<float>(flying_mm) ? 1 : 0;
      }
      if (near >= 4) continue;
      grid.depth_mm[grid.at(x, y)] = 0;
      ++removed;
    }
  return removed;
}

}  // namespace

Result<FusedDepth> fuse_depth(const std::vector<DepthImage>& frames, const CameraModel& camera,
                              const DepthFusionOptions& options) {
  GNATHION_CHECK_OK(check(frames, camera));
  FusedDepth out;
  out.frames = static_cast<int>(frames.size());
  DepthGrid& grid = out.grid;
  grid.width_px = camera.width_px;
  grid.height_px = camera.height_px;
  grid.fx_px = camera.fx_px;
  grid.fy_px = camera.fy_px;
  grid.cx_px = camera.cx_px;
  grid.cy_px = camera.cy_px;
  const std::size_t pixels = frames.front().units.size();
  grid.depth_mm.assign(pixels, 0);
  grid.sigma_mm.assign(pixels, 0);
  const double least = std::max(2.0, options.least_share * static_cast<double>(frames.size()));
  std::vector<double> values, singles;
  for (std::size_t i = 0; i < pixels; ++i) {
    values.clear();
    for (const DepthImage& f : frames) {
      const double z = options.unit_mm * f.units[i];
      if (f.units[i] != 0 && z >= options.near_mm && z <= options.far_mm) values.push_back(z);
    }
    if (static_cast<double>(values.size()) < least) continue;
    const Pixel pixel = fused(values, options.unit_mm);
    grid.depth_mm[i] = static_cast<float>(pixel.depth_mm);
    grid.sigma_mm[i] = static_cast<float>(pixel.sigma_mm);
    singles.push_back(pixel.single_sigma_mm);
  }
  if (singles.empty())
    return bad_input(kWhat, "burst",
                     fmt::format("nothing between {:.0f} and {:.0f} mm; is unit_mm = {} right?",
                                 options.near_mm, options.far_mm, options.unit_mm));
  out.invalid_share = 1 - static_cast<double>(singles.size()) / static_cast<double>(pixels);
  out.frame_sigma_mm = median_of(singles);
  out.flying_share =
      static_cast<double>(remove_flying(grid, options.flying_mm)) / static_cast<double>(pixels);
  return out;
}

}  // namespace gnathion
