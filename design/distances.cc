#include "design/distances.h"

#include <algorithm>
#include <cmath>

#include "design/parallel.h"
#include "design/solid_distance.h"

namespace gnathion {
namespace {

constexpr int kBlock = 4;  // nodes per side of the blocks that are tested as a whole
constexpr double kExactSpacings = 2.5;

/// Searches the nodes of one block, if the surface is near enough to matter for any of them.
void sample_block(const GridShape& shape, const Eigen::Vector3i& low, const MeshQuery& solid,
                  const Rigid3& mesh_from_design, double reach_mm, CoarseGrid& distance,
                  std::vector<char>& known) {
  const Eigen::Vector3i high = (low + Eigen::Vector3i::Constant(kBlock)).cwiseMin(shape.nodes);
  const double half_mm = 0.5 * (kBlock - 1) * shape.spacing_mm;
  const Vector3 centre = shape.position(low.x(), low.y(), low.z()) + Vector3::Constant(half_mm);
  if (!solid.closest(mesh_from_design * centre, reach_mm + std::sqrt(3.0) * half_mm)) return;
  for (int i = low.x(); i < high.x(); ++i)
    for (int j = low.y(); j < high.y(); ++j)
      for (int k = low.z(); k < high.z(); ++k) {
        const auto found = solid_distance(solid, mesh_from_design * shape.position(i, j, k), reach_mm);
        if (!found) continue;
        distance.at(i, j, k) = static_cast<float>(found->distance_mm);
        known[shape.index(i, j, k)] = 1;
      }
}

/// Gives every far node the side of the node before it, from the outside end on.
void carry_sides(CoarseGrid& distance, const std::vector<char>& known, OutsideEnd outside) {
  const GridShape& shape = distance.shape();
  const int nz = shape.nodes.z();
  parallel_each(shape.nodes.x(), [&](int i) {
    for (int j = 0; j < shape.nodes.y(); ++j) {
      float* values = distance.column(i, j);
      bool inside = false;
      for (int n = 0; n < nz; ++n) {
        const int k = outside == OutsideEnd::kBottom ? n : nz - 1 - n;
        if (known[shape.index(i, j, k)])
          inside = values[k] < 0.0f;
        else
          values[k] = inside ? -values[k] : values[k];
      }
    }
  });
}

}  // namespace

CoarseGrid sampled_distance(const GridShape& shape, const MeshQuery& solid, const Rigid3& mesh_from_design,
                            double band_mm, OutsideEnd outside) {
  CoarseGrid distance(shape, static_cast<float>(band_mm));
  std::vector<char> known(shape.size(), 0);
  const double reach_mm = std::min(band_mm, kExactSpacings * shape.spacing_mm);
  const Eigen::Vector3i blocks = (shape.nodes.array() + kBlock - 1) / kBlock;
  parallel_each(blocks.x() * blocks.y(), [&](int column) {
    for (int k = 0; k < blocks.z(); ++k)
      sample_block(shape, kBlock * Eigen::Vector3i(column / blocks.y(), column % blocks.y(), k), solid,
                   mesh_from_design, reach_mm, distance, known);
  });

  std::vector<float> exact = distance.values();
  for (float& v : distance.values()) v = std::abs(v);
  sweep_distances(distance, known, band_mm);
  for (std::size_t i = 0; i < exact.size(); ++i)
    if (known[i]) distance.values()[i] = exact[i];
  carry_sides(distance, known, outside);
  return distance;
}

}  // namespace gnathion
