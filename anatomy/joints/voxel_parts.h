// Sets of voxels: connected parts, what they enclose.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "anatomy/volume/volume.h"

namespace gnathion {

/// 0: none; parts are numbered from 1 in the order of their first voxel. Voxels hang together by faces.
struct VoxelParts {
  std::vector<std::int32_t> part;   ///< per voxel
  std::vector<std::size_t> voxels;  ///< per part; [0] is unused
};
VoxelParts parts_above(const Volume& volume, double level);

/// Lets every part grow, all at the same pace, through the voxels above `level` that no part has yet.
void grow_parts(const Volume& volume, double level, VoxelParts& parts);

/// Voxels that are not of the part and cannot be reached from the outside, when gaps in its wall of up to
/// 2·`seal` voxels count as closed. On the faces of the volume, what the part surrounds is inside.
std::vector<std::uint8_t> enclosed_by(const VoxelGrid& grid, const std::vector<std::uint8_t>& part, int seal);

}  // namespace gnathion
