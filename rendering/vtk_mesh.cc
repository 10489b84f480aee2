#include "rendering/vtk_mesh.h"

#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkUnsignedCharArray.h>

namespace gnathion {

vtkSmartPointer<vtkPolyData> to_vtk(const TriangleMesh& mesh, const Rigid3& scene_from_mesh,
                                    bool with_colors) {
  const auto n = static_cast<vtkIdType>(mesh.vertices_mm.size());
  vtkNew<vtkPoints> points;
  points->SetNumberOfPoints(n);
  vtkNew<vtkFloatArray> normals;
  normals->SetName("Normals");
  normals->SetNumberOfComponents(3);
  normals->SetNumberOfTuples(n);
  const std::vector<Vector3> vertex_normal = vertex_normals(mesh);
  for (vtkIdType i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Vector3 p = scene_from_mesh * mesh.vertices_mm[k], d = scene_from_mesh.rotation * vertex_normal[k];
    points->SetPoint(i, p.data());
    normals->SetTuple(i, d.data());
  }
  vtkNew<vtkCellArray> cells;
  cells->AllocateExact(static_cast<vtkIdType>(mesh.triangles.size()),
                       3 * static_cast<vtkIdType>(mesh.triangles.size()));
  for (const Triangle& t : mesh.triangles) {
    const vtkIdType ids[3] = {t[0], t[1], t[2]};
    cells->InsertNextCell(3, ids);
  }
  auto data = vtkSmartPointer<vtkPolyData>::New();
  data->SetPoints(points);
  data->SetPolys(cells);
  data->GetPointData()->SetNormals(normals);
  if (with_colors && mesh.colors_rgb.size() == mesh.vertices_mm.size()) {
    vtkNew<vtkUnsignedCharArray> colors;
    colors->SetName("Colors");
    colors->SetNumberOfComponents(3);
    colors->SetNumberOfTuples(n);
    for (vtkIdType i = 0; i < n; ++i)
      colors->SetTypedTuple(i, mesh.colors_rgb[static_cast<std::size_t>(i)].data());
    data->GetPointData()->SetScalars(colors);
  }
  return data;
}

}  // namespace gnathion
