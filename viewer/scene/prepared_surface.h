// A mesh made ready to be drawn, drawn while moving, and picked.
#pragma once

#include <vtkPolyData.h>
#include <vtkSmartPointer.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "core/mesh_query.h"
#include "viewer/model/layer.h"

namespace gnathion {

/// All layers together stay at 20 frames a second with software rendering (docs/viewer.md has the figures).
inline constexpr std::size_t kCoarseTriangles = 12000;  ///< of one layer

struct PreparedSurface {
  std::shared_ptr<const TriangleMesh> mesh;
  vtkSmartPointer<vtkPolyData> full, coarse;
  std::vector<std::uint32_t> coarse_source;
  std::shared_ptr<const MeshQuery> query;  ///< for picking; made apart
};

/// Both take up to a second on large meshes: for background jobs. The query, with which the mouse finds the
/// surface, takes twice as long as all that is drawn of it.
inline std::shared_ptr<const MeshQuery> prepare_query(const TriangleMesh& mesh) {
  return std::make_shared<const MeshQuery>(mesh);
}
std::shared_ptr<PreparedSurface> prepare_surface(std::shared_ptr<const TriangleMesh> mesh,
                                                 std::size_t coarse_triangles = kCoarseTriangles);
/// A copy of the polydata with these colours; `source` maps its vertices to the colours' (null: one to one).
vtkSmartPointer<vtkPolyData> with_colors(vtkPolyData* data, const VertexColors& colors,
                                         const std::vector<std::uint32_t>* source);

}  // namespace gnathion
