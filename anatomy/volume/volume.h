// A volume of voxels in space: CBCT, CT, label maps.
//
// Frame Cbct: LPS (x patient's left, y posterior, z superior), millimetres. Right-handed whatever the file's
// own order was. The steps between voxels may differ in length (anisotropic) and need not be at right angles
// (gantry tilt): everything goes through the affine map.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/cbct_frame.h"
#include "core/mesh.h"
#include "core/transform.h"

namespace gnathion {

/// Where voxels lie. Voxel (i, j, k) is centred at origin + step·(i, j, k).
struct VoxelGrid {
  std::array<int, 3> size{0, 0, 0};
  Matrix3 step_mm = Matrix3::Identity();  ///< columns: one voxel along i, j, k
  Vector3 origin_mm = Vector3::Zero();    ///< centre of voxel (0, 0, 0)

  Vector3 spacing_mm() const { return step_mm.colwise().norm().transpose(); }
  double voxel_mm3() const { return std::abs(step_mm.determinant()); }
  /// Voxel coordinates (continuous; integers are voxel centres) to the frame and back.
  Vector3 frame_from_voxel(const Vector3& ijk) const { return origin_mm + step_mm * ijk; }
  Vector3 voxel_from_frame(const Vector3& p_mm) const { return step_mm.inverse() * (p_mm - origin_mm); }
  std::size_t count() const {
    return static_cast<std::size_t>(size[0]) * static_cast<std::size_t>(size[1]) *
           static_cast<std::size_t>(size[2]);
  }
  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(size[1]) + static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(size[0]) +
           static_cast<std::size_t>(i);
  }
  /// Around all voxels, half a voxel beyond the outer centres.
  Box box_mm() const;
};

/// value = slope · stored + intercept (Hounsfield units, or whatever the scanner writes; labels as they are).
/// Voxels are stored as int16 or as float: one of the two vectors is filled, i fastest, then j, then k.
struct Volume {
  VoxelGrid grid;
  std::vector<std::int16_t> voxels16;
  std::vector<float> voxels;
  double slope = 1.0, intercept = 0.0;

  bool empty() const { return voxels16.empty() && voxels.empty(); }
  double value(std::size_t index) const {
    return slope * (voxels16.empty() ? static_cast<double>(voxels[index]) : voxels16[index]) + intercept;
  }
  double value(int i, int j, int k) const { return value(grid.index(i, j, k)); }
  /// Trilinear between voxel centres; `outside` beyond the outer centres.
  double at_voxel(const Vector3& ijk, double outside) const;
  double at(const Vector3& p_mm, double outside) const {
    return at_voxel(grid.voxel_from_frame(p_mm), outside);
  }
};

inline double Volume::at_voxel(const Vector3& ijk, double outside) const {
  int low[3], high[3];
  double part[3];
  for (int a = 0; a < 3; ++a) {
    const int last = grid.size[static_cast<std::size_t>(a)] - 1;
    if (!(ijk[a] >= 0.0) || !(ijk[a] <= last)) return outside;
    low[a] = std::min(static_cast<int>(ijk[a]), last);
    high[a] = std::min(low[a] + 1, last);
    part[a] = ijk[a] - low[a];
  }
  const auto along_i = [&](int j, int k) {
    const double a = value(low[0], j, k), b = value(high[0], j, k);
    return a + part[0] * (b - a);
  };
  const auto along_j = [&](int k) {
    const double a = along_i(low[1], k), b = along_i(high[1], k);
    return a + part[1] * (b - a);
  };
  const double a = along_j(low[2]), b = along_j(high[2]);
  return a + part[2] * (b - a);
}

}  // namespace gnathion
