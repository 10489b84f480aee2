// Depth images to surfaces: neighbours in the image are neighbours on the surface, but where depth jumps.
#pragma once

#include <cstdint>
#include <vector>

#include "acquisition/scanner/scan_ply.h"

namespace gnathion {

/// What a pinhole camera without distortion sees, pixel by pixel, row-major: depth z along its axis.
struct DepthGrid {
  int width_px = 0, height_px = 0;
  double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
  std::vector<float> depth_mm;     ///< 0: nothing seen
  std::vector<float> sigma_mm;     ///< 1σ of the depth
  std::vector<std::uint8_t> grey;  ///< empty, or the picture

  std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_px) + static_cast<std::size_t>(x);
  }
};

struct GridMeshOptions {
  double max_incidence_deg = 78;         ///< a triangle seen flatter than this is a jump
  double jump_sigmas = 4;                ///< and only if it is larger than its noise
  std::size_t smallest_component = 400;  ///< triangles; smaller islands are dropped
};

/// Triangles wind so that normals look at the camera; vertices are in `frame_from_camera`'s frame. Deviations
/// are along the vertex normal.
ScanSurface surface_from_grid(const DepthGrid& grid, const Rigid3& frame_from_camera,
                              const GridMeshOptions& options);

}  // namespace gnathion
