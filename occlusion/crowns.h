// The crowns of an arch as a region of its mesh.
#pragma once

#include <vector>

#include "core/mesh.h"
#include "occlusion/arch.h"

namespace gnathion {

/// How deep each vertex lies behind the occlusal plane towards the arch's gingiva, mm (negative: beyond
/// the plane, towards the opposing arch: cusps that pass it).
std::vector<double> crown_depths_mm(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which);

/// Vertices of the crowns down to depth_mm behind the local occlusal level: the level follows the curve of
/// Spee (98th percentile of the height per 2 mm of arch, smoothed). Palate, floor of the mouth and base are
/// left out by their distance from the arch curve (half_width_mm).
std::vector<bool> crown_region(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which,
                               double depth_mm, double half_width_mm = 9.0);

/// Local occlusal level along the arch, as a depth behind the occlusal plane.
class OcclusalLevel {
 public:
  OcclusalLevel(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which);
  double depth_mm(double s_mm) const;  ///< by interpolation; clamped at the ends

 private:
  double s0_mm_ = 0.0, step_mm_ = 2.0;
  std::vector<double> depth_mm_;
};

/// Triangles whose three corners are all selected.
TriangleMesh region_mesh(const TriangleMesh& mesh, const std::vector<bool>& vertex_selected);

/// Vertices that look at the opposing arch: normal within max_angle_deg of the occlusal direction.
std::vector<bool> occlusal_facing(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which,
                                  double max_angle_deg);

}  // namespace gnathion
