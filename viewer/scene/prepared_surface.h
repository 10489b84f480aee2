// A mesh made ready to be drawn, drawn while moving, and picked; internal to the scene.
#pragma once

#include <vtkPolyData.h>
#include <vtkSmartPointer.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "core/mesh_query.h"
#include "viewer/model/layer.h"

namespace gnathion {

struct PreparedSurface {
  std::shared_ptr<const TriangleMesh> mesh;
  vtkSmartPointer<vtkPolyData> full, coarse;
  std::vector<std::uint32_t> coarse_source;
  std::shared_ptr<const MeshQuery> query;
};

/// Takes up to seconds on large meshes: for background jobs.
std::shared_ptr<PreparedSurface> prepare_surface(std::shared_ptr<const TriangleMesh> mesh,
                                                 std::size_t coarse_triangles);
/// A copy of the polydata with these colours; `source` maps its vertices to the colours' (null: one to one).
vtkSmartPointer<vtkPolyData> with_colors(vtkPolyData* data, const VertexColors& colors,
                                         const std::vector<std::uint32_t>* source);

}  // namespace gnathion
