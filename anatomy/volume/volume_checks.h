// What every volume must fulfil, whatever file it came from.
#pragma once

#include <string>

#include "anatomy/volume/read_volume.h"

namespace gnathion {

/// Refuses sizes that are none or too large, maps that are singular, and spacings that are no head's in
/// millimetres, the likely unit named. Warns of anisotropic voxels and of voxels too coarse for a joint.
Status check_grid(const VoxelGrid& grid, std::size_t bytes_a_voxel, std::uint64_t largest_bytes,
                  const std::string& name, std::vector<std::string>& warnings);

inline constexpr const char* kReadVolume = "cannot read volume";

}  // namespace gnathion
