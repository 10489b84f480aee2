#include "design/distances.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/triangle_distance.h"
#include "design/parallel.h"
#include "design/solid_distance.h"

namespace gnathion {
namespace {

constexpr int kBlock = 2;               // nodes per side of the blocks that are searched together
constexpr int kSuperBlock = 4;          // and of those that are tested as a whole
constexpr double kShellSpacings = 1.2;  // searched in the mesh; from there nearest triangles are handed on
constexpr double kExactSpacings = 2.5;
constexpr std::uint32_t kNoTriangle = 0xffffffffu;

/// Distances on a grid while they grow from the surface outwards.
class Sampler {
 public:
  Sampler(const GridShape& shape, const MeshQuery& solid, const Rigid3& mesh_from_design, double band_mm)
      : distance(shape, static_cast<float>(band_mm)),
        known(shape.size(), 0),
        shape_(shape),
        solid_(solid),
        mesh_from_design_(mesh_from_design),
        triangle_(shape.size(), kNoTriangle) {}

  CoarseGrid distance;
  std::vector<char> known;

  /// The nodes within reach of the surface, by search.
  void search_shell(double reach_mm) {
    const Eigen::Vector3i blocks = (shape_.nodes.array() + kSuperBlock - 1) / kSuperBlock;
    const double radius_mm = 0.5 * (kSuperBlock - 1) * shape_.spacing_mm * std::sqrt(3.0) * (1.0 + 1e-9);
    parallel_each(blocks.x() * blocks.y(), [&](int column) {
      SolidGroup group(solid_);
      for (int k = 0; k < blocks.z(); ++k) {
        const Index low = kSuperBlock * Index(column / blocks.y(), column % blocks.y(), k);
        const Vector3 centre =
            place(low) +
            mesh_from_design_.rotation * Vector3::Constant(0.5 * (kSuperBlock - 1) * shape_.spacing_mm);
        if (!solid_.closest(centre, reach_mm + radius_mm)) continue;
        for (int n = 0; n < 8; ++n)
          search_block(low + kBlock * Index(n & 1, n >> 1 & 1, n >> 2), reach_mm, group);
      }
    });
  }

  /// Further nodes take the nearest of the triangles that their neighbours found, layer by layer: what a
  /// search would find, but for crests that none of 26 neighbours sees.
  void hand_on(double reach_mm) {
    std::vector<std::uint32_t> last;
    for (std::uint32_t i = 0; i < known.size(); ++i)
      if (known[i]) last.push_back(i);
    std::vector<char> asked = known;
    while (!last.empty()) {
      const std::vector<std::uint32_t> layer = neighbours_of(last, asked);
      std::vector<float> found(layer.size());
      std::vector<std::uint32_t> by(layer.size(), kNoTriangle);
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, layer.size(), 256), [&](const auto& range) {
        for (std::size_t n = range.begin(); n != range.end(); ++n)
          take_from_neighbours(layer[n], reach_mm, found[n], by[n]);
      });
      last.clear();
      for (std::size_t n = 0; n < layer.size(); ++n) {
        if (by[n] == kNoTriangle) continue;
        distance.values()[layer[n]] = found[n];
        triangle_[layer[n]] = by[n];
        known[layer[n]] = 1;
        last.push_back(layer[n]);
      }
    }
  }

 private:
  using Index = Eigen::Vector3i;

  Vector3 place(const Index& node) const {
    return mesh_from_design_ * shape_.position(node.x(), node.y(), node.z());
  }
  Index node_at(std::uint32_t i) const {
    const auto nz = static_cast<std::uint32_t>(shape_.nodes.z()),
               ny = static_cast<std::uint32_t>(shape_.nodes.y());
    return {static_cast<int>(i / nz / ny), static_cast<int>(i / nz % ny), static_cast<int>(i % nz)};
  }

  void search_block(const Index& low, double reach_mm, SolidGroup& group) {
    const Index high = (low + Index::Constant(kBlock)).cwiseMin(shape_.nodes);
    std::vector<SolidGroup::Point> points;
    std::vector<std::size_t> index;
    for (int i = low.x(); i < high.x(); ++i)
      for (int j = low.y(); j < high.y(); ++j)
        for (int k = low.z(); k < high.z(); ++k) {
          points.push_back({place({i, j, k}), reach_mm, false, {}});
          index.push_back(shape_.index(i, j, k));
        }
    group.measure(points);
    for (std::size_t n = 0; n < points.size(); ++n) {
      if (!points[n].found) continue;
      distance.values()[index[n]] = static_cast<float>(points[n].distance.distance_mm);
      triangle_[index[n]] = points[n].distance.closest.triangle;
      known[index[n]] = 1;
    }
  }

  /// Calls body(index) for the nodes about one.
  template <class Body>
  void each_neighbour(const Index& node, const Body& body) const {
    const Index low = (node - Index::Ones()).cwiseMax(0);
    const Index high = (node + Index::Ones()).cwiseMin(shape_.nodes - Index::Ones());
    for (int i = low.x(); i <= high.x(); ++i)
      for (int j = low.y(); j <= high.y(); ++j)
        for (int k = low.z(); k <= high.z(); ++k) body(static_cast<std::uint32_t>(shape_.index(i, j, k)));
  }

  std::vector<std::uint32_t> neighbours_of(const std::vector<std::uint32_t>& nodes,
                                           std::vector<char>& asked) const {
    std::vector<std::uint32_t> out;
    for (const std::uint32_t node : nodes)
      each_neighbour(node_at(node), [&](std::uint32_t other) {
        if (asked[other]) return;
        asked[other] = 1;
        out.push_back(other);
      });
    return out;
  }

  void take_from_neighbours(std::uint32_t node, double reach_mm, float& found, std::uint32_t& by) const {
    const Index at = node_at(node);
    const Vector3 p = place(at);
    const TriangleMesh& mesh = solid_.mesh();
    double least = reach_mm * reach_mm;
    std::array<std::uint32_t, 26> seen;
    std::size_t count = 0;
    each_neighbour(at, [&](std::uint32_t other) {
      const std::uint32_t t = triangle_[other];
      if (!known[other] || std::find(seen.begin(), seen.begin() + count, t) != seen.begin() + count) return;
      seen[count++] = t;
      const double squared =
          closest_on_triangle(p, mesh.corner(t, 0), mesh.corner(t, 1), mesh.corner(t, 2)).squared_distance;
      if (squared > least || (squared == least && by != kNoTriangle && t > by)) return;
      least = squared;
      by = t;
    });
    if (by == kNoTriangle) return;
    // A ball that meets a neighbour's ball lies on its side. `mine` may be a little large, since only the
    // neighbours' triangles were tried: the balls that meet most tell, and where both sides' do, a search.
    const double mine = std::sqrt(least);
    double outside = 0.0, inside = 0.0;
    each_neighbour(at, [&](std::uint32_t other) {
      if (!known[other]) return;
      const double theirs = distance.values()[other];
      const double apart = (node_at(other) - at).cast<double>().norm() * shape_.spacing_mm;
      double& most = theirs < 0.0 ? inside : outside;
      most = std::max(most, mine + std::abs(theirs) - 1.001 * apart);
    });
    int side = outside > inside ? 1 : -1;
    if (std::abs(outside - inside) < 0.1 * shape_.spacing_mm) {
      const auto searched = solid_distance(solid_, p, reach_mm + 1e-3);
      side = searched && searched->distance_mm < 0.0 ? -1 : 1;
    }
    found = static_cast<float>(side * mine);
  }

  const GridShape shape_;
  const MeshQuery& solid_;
  const Rigid3 mesh_from_design_;
  std::vector<std::uint32_t> triangle_;  ///< the nearest one, of known nodes
};

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
  Sampler sampler(shape, solid, mesh_from_design, band_mm);
  sampler.search_shell(std::min(band_mm, kShellSpacings * shape.spacing_mm));
  sampler.hand_on(std::min(band_mm, kExactSpacings * shape.spacing_mm));
  CoarseGrid& distance = sampler.distance;
  const std::vector<char>& known = sampler.known;
  std::vector<float> exact = distance.values();
  for (float& v : distance.values()) v = std::abs(v);
  sweep_distances(distance, known, band_mm);
  for (std::size_t i = 0; i < exact.size(); ++i)
    if (known[i]) distance.values()[i] = exact[i];
  carry_sides(distance, known, outside);
  return std::move(distance);
}

}  // namespace gnathion
