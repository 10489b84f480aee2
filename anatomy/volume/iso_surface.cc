#include "anatomy/volume/iso_surface.h"

#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <vtkShortArray.h>

namespace gnathion {
namespace {

/// Voxels along each axis that a box reaches: first and one past the last.
struct VoxelRange {
  std::array<int, 3> low{0, 0, 0}, high{0, 0, 0};
  bool empty() const { return low[0] >= high[0] || low[1] >= high[1] || low[2] >= high[2]; }
};

VoxelRange range_of(const VoxelGrid& grid, const std::optional<Box>& box_mm) {
  VoxelRange r;
  r.high = grid.size;
  if (!box_mm) return r;
  Box voxels;
  for (int corner = 0; corner < 8; ++corner) {
    Vector3 p;
    for (int a = 0; a < 3; ++a) p[a] = (corner >> a & 1) != 0 ? box_mm->max_mm[a] : box_mm->min_mm[a];
    voxels.extend(grid.voxel_from_frame(p));
  }
  for (int a = 0; a < 3; ++a) {
    const auto k = static_cast<std::size_t>(a);
    const double last = grid.size[k];
    r.low[k] = static_cast<int>(std::clamp(std::floor(voxels.min_mm[a]), 0.0, last));
    r.high[k] = static_cast<int>(std::clamp(std::ceil(voxels.max_mm[a]) + 1.0, 0.0, last));
  }
  return r;
}

/// VTK looks at the voxels where they are: no copy. Runs in voxel coordinates; the affine map comes after.
TriangleMesh flying_edges(const Volume& volume, double level) {
  vtkNew<vtkImageData> image;
  image->SetDimensions(volume.grid.size[0], volume.grid.size[1], volume.grid.size[2]);
  vtkNew<vtkShortArray> shorts;
  vtkNew<vtkFloatArray> floats;
  const auto count = static_cast<vtkIdType>(volume.grid.count());
  if (!volume.voxels16.empty()) {
    shorts->SetArray(const_cast<std::int16_t*>(volume.voxels16.data()), count, 1);
    image->GetPointData()->SetScalars(shorts);
  } else {
    floats->SetArray(const_cast<float*>(volume.voxels.data()), count, 1);
    image->GetPointData()->SetScalars(floats);
  }
  vtkNew<vtkFlyingEdges3D> edges;
  edges->SetInputData(image);
  edges->ComputeNormalsOff();
  edges->ComputeGradientsOff();
  edges->ComputeScalarsOff();
  edges->SetValue(0, (level - volume.intercept) / volume.slope);
  edges->Update();
  vtkPolyData* found = edges->GetOutput();

  TriangleMesh mesh;
  mesh.vertices_mm.resize(static_cast<std::size_t>(found->GetNumberOfPoints()));
  for (std::size_t v = 0; v < mesh.vertices_mm.size(); ++v) {
    double p[3];
    found->GetPoint(static_cast<vtkIdType>(v), p);
    mesh.vertices_mm[v] = volume.grid.frame_from_voxel({p[0], p[1], p[2]});
  }
  mesh.triangles.reserve(static_cast<std::size_t>(found->GetNumberOfPolys()));
  vtkCellArray* polys = found->GetPolys();
  polys->InitTraversal();
  vtkIdType n = 0;
  const vtkIdType* ids = nullptr;
  while (polys->GetNextCell(n, ids) != 0)
    if (n == 3)
      mesh.triangles.push_back({static_cast<std::uint32_t>(ids[0]), static_cast<std::uint32_t>(ids[1]),
                                static_cast<std::uint32_t>(ids[2])});
  return mesh;
}

/// Whether most triangles look where values rise. The order of corners depends on the handedness of the map
/// and on the filter's habit; the volume itself decides.
bool looks_into_bone(const Volume& volume, const TriangleMesh& mesh) {
  const double reach = 0.5 * volume.grid.spacing_mm().minCoeff();
  double sum = 0.0;
  const std::size_t step = mesh.triangles.size() / 2000 + 1;
  for (std::size_t t = 0; t < mesh.triangles.size(); t += step) {
    const Vector3 n = face_normal_scaled(mesh, t);
    if (!(n.norm() > 0.0)) continue;
    const Vector3 centre = (mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0;
    const Vector3 d = reach * n.normalized();
    const double low = volume.at(centre - d, NAN), high = volume.at(centre + d, NAN);
    if (std::isfinite(low) && std::isfinite(high)) sum += high > low ? 1.0 : -1.0;
  }
  return sum > 0.0;
}

}  // namespace

Volume cropped(const Volume& volume, const Box& box_mm) {
  const VoxelRange r = range_of(volume.grid, box_mm);
  Volume out;
  out.slope = volume.slope;
  out.intercept = volume.intercept;
  out.grid = volume.grid;
  out.grid.origin_mm = volume.grid.frame_from_voxel(Vector3(r.low[0], r.low[1], r.low[2]));
  if (r.empty()) {
    out.grid.size = {0, 0, 0};
    return out;
  }
  for (std::size_t a = 0; a < 3; ++a) out.grid.size[a] = r.high[a] - r.low[a];
  const auto copy = [&](const auto& from, auto& to) {
    to.reserve(out.grid.count());
    for (int k = r.low[2]; k < r.high[2]; ++k)
      for (int j = r.low[1]; j < r.high[1]; ++j) {
        const auto row = from.begin() + static_cast<std::ptrdiff_t>(volume.grid.index(r.low[0], j, k));
        to.insert(to.end(), row, row + out.grid.size[0]);
      }
  };
  if (!volume.voxels16.empty())
    copy(volume.voxels16, out.voxels16);
  else
    copy(volume.voxels, out.voxels);
  return out;
}

TriangleMesh iso_surface(const Volume& volume, double level, const std::optional<Box>& box_mm) {
  if (volume.empty()) return {};
  for (const int n : volume.grid.size)
    if (n < 2) return {};
  if (box_mm) return iso_surface(cropped(volume, *box_mm), level);
  TriangleMesh mesh = flying_edges(volume, level);
  if (looks_into_bone(volume, mesh)) flip_orientation(mesh);
  return mesh;
}

}  // namespace gnathion
