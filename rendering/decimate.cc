#include "rendering/decimate.h"

#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPolyData.h>
#include <vtkQuadricClustering.h>
#include <vtkQuadricDecimation.h>

#include <cmath>

#include "rendering/vtk_mesh.h"

namespace gnathion {
namespace {

TriangleMesh from_vtk(vtkPolyData& data) {
  TriangleMesh mesh;
  mesh.vertices_mm.resize(static_cast<std::size_t>(data.GetNumberOfPoints()));
  for (vtkIdType i = 0; i < data.GetNumberOfPoints(); ++i)
    data.GetPoint(i, mesh.vertices_mm[static_cast<std::size_t>(i)].data());
  vtkNew<vtkIdList> ids;
  for (vtkIdType c = 0; c < data.GetNumberOfCells(); ++c) {
    data.GetCellPoints(c, ids);
    if (ids->GetNumberOfIds() != 3) continue;
    Triangle t;
    for (int k = 0; k < 3; ++k) t[static_cast<std::size_t>(k)] = static_cast<std::uint32_t>(ids->GetId(k));
    mesh.triangles.push_back(t);
  }
  return submesh(mesh, std::vector<bool>(mesh.triangles.size(), true));
}

/// One vertex a cell of a lattice: fast on a million triangles.
TriangleMesh clustered(const TriangleMesh& mesh, double cell_mm) {
  const Vector3 size = bounding_box(mesh).size_mm();
  vtkNew<vtkQuadricClustering> filter;
  filter->AutoAdjustNumberOfDivisionsOff();
  const auto divisions = [&](double length) {
    return std::max(1, static_cast<int>(std::ceil(length / cell_mm)));
  };
  filter->SetNumberOfDivisions(divisions(size.x()), divisions(size.y()), divisions(size.z()));
  filter->CopyCellDataOff();
  filter->UseFeatureEdgesOn();  // rims stay smooth
  filter->SetInputData(to_vtk(mesh, Rigid3{}));
  filter->Update();
  return from_vtk(*filter->GetOutput());
}

}  // namespace

TriangleMesh decimated(const TriangleMesh& mesh, std::size_t triangles) {
  TriangleMesh small;
  small.vertices_mm = mesh.vertices_mm;
  small.triangles = mesh.triangles;
  if (small.triangles.size() <= triangles) return small;
  const double wanted = static_cast<double>(triangles);
  // Edge collapse is accurate and slow; large meshes are first clustered to a few times the size.
  if (static_cast<double>(small.triangles.size()) > 4 * wanted) {
    double cell_mm = std::sqrt(surface_area_mm2(small) / (3 * wanted) * 2);
    TriangleMesh coarse = clustered(small, cell_mm);
    if (static_cast<double>(coarse.triangles.size()) > wanted) small = std::move(coarse);
  }
  vtkNew<vtkQuadricDecimation> filter;
  filter->SetTargetReduction(1 - wanted / static_cast<double>(small.triangles.size()));
  filter->SetInputData(to_vtk(small, Rigid3{}));
  filter->Update();
  return from_vtk(*filter->GetOutput());
}

}  // namespace gnathion
