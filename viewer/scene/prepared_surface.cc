#include "viewer/scene/prepared_surface.h"

#include <vtkDataArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkUnsignedCharArray.h>

#include <array>

#include "rendering/level_of_detail.h"
#include "rendering/vtk_mesh.h"

namespace gnathion {

std::shared_ptr<PreparedSurface> prepare_surface(std::shared_ptr<const TriangleMesh> mesh,
                                                 std::size_t coarse_triangles) {
  auto out = std::make_shared<PreparedSurface>();
  out->full = to_vtk(*mesh, Rigid3::identity());
  const CoarseMesh coarse = clustered(*mesh, coarse_triangles);
  out->coarse = to_vtk(coarse.mesh, Rigid3::identity());
  out->coarse_source = coarse.source;
  // What VTK would work out at the first drawing: threads that draw the same surface find it known.
  out->full->ComputeBounds();
  out->full->GetCellsBounds(std::array<double, 6>{}.data());
  for (int k = 0; k < 3; ++k) {
    double range[2];
    out->full->GetPoints()->GetData()->GetRange(range, k);
    out->full->GetPoints()->GetData()->GetFiniteRange(range, k);
  }
  out->mesh = std::move(mesh);
  return out;
}

vtkSmartPointer<vtkPolyData> with_colors(vtkPolyData* data, const VertexColors& colors,
                                         const std::vector<std::uint32_t>* source) {
  auto copy = vtkSmartPointer<vtkPolyData>::New();
  copy->ShallowCopy(data);
  vtkNew<vtkUnsignedCharArray> array;
  array->SetName("Colors");
  array->SetNumberOfComponents(3);
  array->SetNumberOfTuples(data->GetNumberOfPoints());
  for (vtkIdType i = 0; i < data->GetNumberOfPoints(); ++i) {
    const std::size_t at = source ? (*source)[static_cast<std::size_t>(i)] : static_cast<std::size_t>(i);
    constexpr std::array<std::uint8_t, 3> kNone = {160, 160, 160};
    array->SetTypedTuple(i, at < colors.size() ? colors[at].data() : kNone.data());
  }
  copy->GetPointData()->SetScalars(array);
  return copy;
}

}  // namespace gnathion
