#include "anatomy/volume/volume_checks.h"

#include <fmt/format.h>

#include <Eigen/Geometry>

namespace gnathion {
namespace {

constexpr double kCoarseMm = 0.7;  ///< joint spaces are 1.5 to 4 mm: fewer than three voxels show none

/// Voxels of heads measure 0.05 to 5 mm.
std::string likely_unit(double voxel) {
  if (voxel > 2e-5 && voxel < 6e-3) return ": metres? Voxel sizes must be in millimetres";
  if (voxel > 40.0 && voxel < 6e3) return ": micrometres? Voxel sizes must be in millimetres";
  return ": no part of a head in millimetres";
}

}  // namespace

Status check_grid(const VoxelGrid& grid, std::size_t bytes_a_voxel, std::uint64_t largest_bytes,
                  const std::string& name, std::vector<std::string>& warnings) {
  double bytes = static_cast<double>(bytes_a_voxel);
  for (const int n : grid.size) {
    if (n < 1) return bad_input(kReadVolume, name, "a side has no voxels");
    bytes *= n;
  }
  if (bytes > static_cast<double>(largest_bytes))
    return bad_input(kReadVolume, name,
                     fmt::format("{} x {} x {} voxels would take {:.0f} MiB, {} are allowed", grid.size[0],
                                 grid.size[1], grid.size[2], bytes / 1048576.0, largest_bytes >> 20));
  if (!grid.step_mm.allFinite() || !grid.origin_mm.allFinite())
    return bad_input(kReadVolume, name, "its place in space is not finite");
  const Vector3 spacing = grid.spacing_mm();
  const double smallest = spacing.minCoeff(), largest = spacing.maxCoeff();
  double extent = 0.0;
  for (int a = 0; a < 3; ++a) extent = std::max(extent, spacing[a] * grid.size[static_cast<std::size_t>(a)]);
  // The limits leave room for a single slice and for a whole body, not for another unit.
  if (!(smallest > 0.0) || extent < 5.0 || extent > 3000.0 || largest > 20.0)
    return bad_input(kReadVolume, name,
                     fmt::format("voxels of {:.3g} x {:.3g} x {:.3g}, {:.3g} across{}", spacing.x(),
                                 spacing.y(), spacing.z(), extent, likely_unit(smallest)));
  const double volume_share = grid.voxel_mm3() / spacing.prod();
  if (!(volume_share > 0.2)) return bad_input(kReadVolume, name, "its axes lie in one plane");
  if (largest > 1.2 * smallest)
    warnings.push_back(fmt::format("voxels are not cubes: {:.3g} x {:.3g} x {:.3g} mm", spacing.x(),
                                   spacing.y(), spacing.z()));
  if (largest > kCoarseMm)
    warnings.push_back(fmt::format("{:.2g} mm voxels are coarse for a joint space of 1.5 to 4 mm", largest));
  return {};
}

}  // namespace gnathion
