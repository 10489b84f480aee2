#include "design/distances.h"

#include "design/parallel.h"

namespace gnathion {

CoarseGrid sampled_distance(const GridShape& shape, const MeshQuery& solid, const Rigid3& mesh_from_design,
                            double band_mm, OutsideEnd outside) {
  CoarseGrid grid(shape, static_cast<float>(band_mm));
  const int nz = shape.nodes.z();
  parallel_each(shape.nodes.x() * shape.nodes.y(), [&](int column) {
    const int i = column / shape.nodes.y(), j = column % shape.nodes.y();
    float* values = grid.column(i, j);
    float side = 1.0f;
    double slack = 0.0;  // the next node within this of the last query cannot be in the band
    for (int n = 0; n < nz; ++n) {
      const int k = outside == OutsideEnd::kBottom ? n : nz - 1 - n;
      slack -= shape.spacing_mm;
      if (slack > 0.0) {
        values[k] = side * static_cast<float>(band_mm);
        continue;
      }
      const double reach = 4.0 * band_mm;
      const auto found = solid.signed_distance(mesh_from_design * shape.position(i, j, k), reach);
      const double distance = found ? std::abs(found->distance_mm) : reach;
      slack = distance - band_mm;
      if (found && distance < band_mm) side = found->distance_mm < 0.0 ? -1.0f : 1.0f;
      values[k] = side * static_cast<float>(std::min(distance, band_mm));
    }
  });
  return grid;
}

}  // namespace gnathion
