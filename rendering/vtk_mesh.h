// Meshes as VTK data; internal to what links VTK.
#pragma once

#include <vtkPolyData.h>
#include <vtkSmartPointer.h>

#include "core/mesh.h"

namespace gnathion {

/// Vertices posed into the scene, triangles, unit point normals (angle-weighted), colours where wanted.
vtkSmartPointer<vtkPolyData> to_vtk(const TriangleMesh& mesh, const Rigid3& scene_from_mesh,
                                    bool with_colors = false);

}  // namespace gnathion
