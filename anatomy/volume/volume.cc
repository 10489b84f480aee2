#include "anatomy/volume/volume.h"

namespace gnathion {

Box VoxelGrid::box_mm() const {
  Box box;
  for (int corner = 0; corner < 8; ++corner) {
    Vector3 ijk;
    for (int a = 0; a < 3; ++a)
      ijk[a] = (corner >> a & 1) != 0 ? size[static_cast<std::size_t>(a)] - 0.5 : -0.5;
    box.extend(frame_from_voxel(ijk));
  }
  return box;
}

}  // namespace gnathion
