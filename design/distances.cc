#include "design/distances.h"

#include <algorithm>
#include <cmath>

#include "design/parallel.h"
#include "design/solid_distance.h"

namespace gnathion {
namespace {

constexpr int kBlock = 3;  // nodes per side of the blocks that are tested as a whole
constexpr double kExactSpacings = 2.5;

/// Searches the nodes of one block.
void sample_block(const GridShape& shape, const Eigen::Vector3i& low, SolidGroup& solid,
                  const Rigid3& mesh_from_design, double reach_mm, CoarseGrid& distance,
                  std::vector<char>& known) {
  const Eigen::Vector3i high = (low + Eigen::Vector3i::Constant(kBlock)).cwiseMin(shape.nodes);
  std::vector<SolidGroup::Point> points;
  std::vector<std::size_t> index;
  for (int i = low.x(); i < high.x(); ++i)
    for (int j = low.y(); j < high.y(); ++j)
      for (int k = low.z(); k < high.z(); ++k) {
        points.push_back({mesh_from_design * shape.position(i, j, k), reach_mm, false, {}});
        index.push_back(shape.index(i, j, k));
      }
  solid.measure(points);
  for (std::size_t n = 0; n < points.size(); ++n) {
    if (!points[n].found) continue;
    distance.values()[index[n]] = static_cast<float>(points[n].distance.distance_mm);
    known[index[n]] = 1;
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
    SolidGroup group(solid);
    for (int k = 0; k < blocks.z(); ++k)
      sample_block(shape, kBlock * Eigen::Vector3i(column / blocks.y(), column % blocks.y(), k), group,
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
