// Polygonises an implicit surface so that the result is manifold by construction.
#pragma once

#include <functional>

#include "core/mesh.h"

namespace gnathion {

/// Negative inside; roughly a distance near the surface, its sign exact everywhere.
using SurfaceField = std::function<double(const Vector3&)>;

/// Surface of `field` inside `box`, open where the box cuts it, with edges about as long as `step_mm`;
/// vertices lie on the zero of the field. Triangles face the positive side.
TriangleMesh polygonised(const SurfaceField& field, const Box& box, double step_mm);

/// The part where `outside` is negative, cut along its zero.
TriangleMesh trimmed(const TriangleMesh& mesh, const SurfaceField& outside);

/// The largest component alone.
TriangleMesh largest_component(const TriangleMesh& mesh);

}  // namespace gnathion
