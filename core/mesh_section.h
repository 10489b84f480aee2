// Cross-sections of meshes by planes.
#pragma once

#include <vector>

#include "core/mesh.h"

namespace gnathion {

using Polyline2 = std::vector<Eigen::Vector2d>;

/// A plane with axes: p = origin + x·x_axis + y·y_axis; both unit, orthogonal.
struct SectionPlane {
  Vector3 origin_mm = Vector3::Zero();
  Vector3 x_axis = Vector3::UnitX();
  Vector3 y_axis = Vector3::UnitY();
};

/// Where the plane cuts the mesh, as chains of points in plane coordinates, mm. Closed chains repeat
/// their first point. Chains are joined along shared edges of the mesh.
std::vector<Polyline2> cut_mesh(const TriangleMesh& mesh, const SectionPlane& plane);

}  // namespace gnathion
