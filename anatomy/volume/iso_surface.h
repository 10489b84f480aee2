// Surfaces where a volume passes through a value.
#pragma once

#include <optional>

#include "anatomy/volume/volume.h"

namespace gnathion {

/// Triangles face the lower values (out of bone into tissue). Only within `box_mm` (the volume's frame) where
/// it is given. Open where the volume or the box cuts. Empty where nothing passes through `level`.
TriangleMesh iso_surface(const Volume& volume, double level, const std::optional<Box>& box_mm = {});

/// The box's part of a volume, whole voxels; empty where they do not meet.
Volume cropped(const Volume& volume, const Box& box_mm);

/// Values that part air, soft tissue and bone by Otsu's criterion with three classes over the volume's
/// histogram.
struct TissueLevels {
  double skin = 0.0;          ///< between air and soft tissue
  double bone = 0.0;          ///< between soft tissue and bone
  double crown = 0.0;         ///< half way from soft tissue to enamel
  double soft = 0.0;          ///< mean of soft tissue
  std::optional<double> air;  ///< mean of air; nothing where the volume holds none
};
TissueLevels tissue_levels(const Volume& volume);

}  // namespace gnathion
