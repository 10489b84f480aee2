// Which voxels of a volume belong to the mandible and move with it.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "anatomy/volume/volume.h"
#include "core/result.h"

namespace gnathion {

/// A part of a volume's grid with one flag a voxel.
struct VoxelMask {
  std::array<int, 3> low{0, 0, 0};   ///< first voxel of the part, in the volume
  std::array<int, 3> size{0, 0, 0};  ///< voxels along i, j, k
  std::vector<std::uint8_t> inside;  ///< i fastest

  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(size[1]) + static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(size[0]) +
           static_cast<std::size_t>(i);
  }
  std::size_t count() const;
};

/// Bone above `level` that hangs together with the seeds (points on the condyle's surface, the volume's
/// frame) inside the box, its marrow filled, and one voxel beyond: what partial volume has of it. Refused
/// (kInput): no bone at the seeds; bone that also holds a point of `not_these_mm` (the fossa).
Result<VoxelMask> mandible_from_bone(const Volume& volume, double level, const std::vector<Vector3>& seeds_mm,
                                     const std::vector<Vector3>& not_these_mm, const Box& box_mm);
/// Voxels of the box whose centre has one of the labels in a label map of the same frame, and one voxel
/// beyond.
Result<VoxelMask> mandible_from_labels(const Volume& volume, const Volume& labels,
                                       const std::vector<int>& which, const Box& box_mm);

}  // namespace gnathion
