#include "design/extraction.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "design/cube_table.h"
#include "design/parallel.h"

namespace gnathion {
namespace {

constexpr double kEndMargin =
    0.02;  // vertices keep this part of an edge from its ends: no degenerate triangles
constexpr int kNone = -1;

/// Fine samples in blocks of refinement³ nodes, one block per coarse cell that is needed.
class Extractor {
 public:
  Extractor(const ExtractionField& field, const GridShape& coarse, int refinement)
      : field_(field),
        coarse_(coarse),
        k_(refinement),
        cells_(coarse.nodes - Eigen::Vector3i::Ones()),
        block_of_(static_cast<std::size_t>(cells_.x()) * static_cast<std::size_t>(cells_.y()) *
                      static_cast<std::size_t>(cells_.z()),
                  kNone),
        active_(block_of_.size(), 0) {}

  TriangleMesh run() {
    activate(initial_cells());
    while (true) {
      std::vector<std::size_t> more = crossed_neighbours();
      if (more.empty()) break;
      activate(more);
    }
    return marched();
  }

 private:
  using Index = Eigen::Vector3i;

  std::size_t cell_id(const Index& c) const {
    return (static_cast<std::size_t>(c.x()) * static_cast<std::size_t>(cells_.y()) +
            static_cast<std::size_t>(c.y())) *
               static_cast<std::size_t>(cells_.z()) +
           static_cast<std::size_t>(c.z());
  }
  Index cell_at(std::size_t id) const {
    const auto nz = static_cast<std::size_t>(cells_.z()), ny = static_cast<std::size_t>(cells_.y());
    return {static_cast<int>(id / nz / ny), static_cast<int>(id / nz % ny), static_cast<int>(id % nz)};
  }
  bool in_box(const Index& c) const { return (c.array() >= 0).all() && (c.array() < cells_.array()).all(); }
  std::size_t block_size() const { return static_cast<std::size_t>(k_ * k_ * k_); }

  /// Storage slot of a fine node; kNone where its block is absent.
  std::ptrdiff_t slot(const Index& node) const {
    const Index c(node.x() / k_, node.y() / k_, node.z() / k_);
    if (!in_box(c)) return kNone;
    const std::int32_t block = block_of_[cell_id(c)];
    if (block == kNone) return kNone;
    const Index l = node - c * k_;
    return static_cast<std::ptrdiff_t>(static_cast<std::size_t>(block) * block_size()) +
           (l.x() * k_ + l.y()) * k_ + l.z();
  }
  Vector3 position(const Index& node) const {
    return coarse_.origin_mm + (coarse_.spacing_mm / k_) * node.cast<double>();
  }

  /// Coarse cells that the level may pass, by the estimate at their corners.
  std::vector<std::size_t> initial_cells() const {
    std::vector<float> corner(coarse_.size());
    parallel_each(coarse_.nodes.x(), [&](int i) {
      for (int j = 0; j < coarse_.nodes.y(); ++j)
        for (int k = 0; k < coarse_.nodes.z(); ++k)
          corner[coarse_.index(i, j, k)] = static_cast<float>(field_.estimate(coarse_.position(i, j, k)));
    });
    const float reach = static_cast<float>(0.6 * coarse_.spacing_mm);
    std::vector<std::size_t> out;
    for (std::size_t id = 0; id < active_.size(); ++id) {
      const Index c = cell_at(id);
      float low = 1e9f, high = -1e9f;
      for (int n = 0; n < 8; ++n) {
        const float v = corner[coarse_.index(c.x() + (n & 1), c.y() + (n >> 1 & 1), c.z() + (n >> 2 & 1))];
        low = std::min(low, v);
        high = std::max(high, v);
      }
      if (low <= reach && high >= -reach) out.push_back(id);
    }
    return out;
  }

  /// Adds blocks for the cells and for the nodes on their upper faces, and samples what is new.
  void activate(const std::vector<std::size_t>& ids) {
    std::vector<std::size_t> fresh;
    for (const std::size_t id : ids) {
      active_[id] = 1;
      const Index c = cell_at(id);
      for (int n = 0; n < 8; ++n) {
        const Index d = c + Index(n & 1, n >> 1 & 1, n >> 2 & 1);
        if (!in_box(d)) continue;
        std::int32_t& block = block_of_[cell_id(d)];
        if (block != kNone) continue;
        block = static_cast<std::int32_t>(blocks_++);
        fresh.push_back(cell_id(d));
      }
    }
    values_.resize(blocks_ * block_size());
    parallel_each(fresh.size(), [&](std::size_t f) { sample_block(fresh[f]); });
  }

  void sample_block(std::size_t id) {
    const Index base = cell_at(id) * k_;
    const double near = 2.0 * coarse_.spacing_mm / k_ + field_.estimate_error_mm;
    for (int x = 0; x < k_; ++x)
      for (int y = 0; y < k_; ++y)
        for (int z = 0; z < k_; ++z) {
          const Index node = base + Index(x, y, z);
          const Vector3 p = position(node);
          double value = field_.estimate(p);
          if (std::abs(value) < near) value = field_.exact(p);
          values_[static_cast<std::size_t>(slot(node))] = static_cast<float>(value);
        }
  }

  bool inside(const Index& node) const {
    const std::ptrdiff_t s = slot(node);
    return s != kNone && values_[static_cast<std::size_t>(s)] < 0.0f;
  }

  /// Cells beyond a face of an active cell that the level crosses.
  std::vector<std::size_t> crossed_neighbours() const {
    std::vector<std::size_t> out;
    for (std::size_t id = 0; id < active_.size(); ++id) {
      if (!active_[id]) continue;
      const Index c = cell_at(id);
      for (int axis = 0; axis < 3; ++axis)
        for (int side = 0; side < 2; ++side) {
          Index d = c;
          d[axis] += side ? 1 : -1;
          if (!in_box(d) || active_[cell_id(d)]) continue;
          if (face_crossed(c * k_, axis, side)) out.push_back(cell_id(d));
        }
    }
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
  }

  bool face_crossed(const Index& base, int axis, int side) const {
    int in = 0;
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (int a = 0; a <= k_; ++a)
      for (int b = 0; b <= k_; ++b) {
        Index node = base;
        node[axis] += side ? k_ : 0;
        node[u] += a;
        node[v] += b;
        in += inside(node) ? 1 : 0;
      }
    return in != 0 && in != (k_ + 1) * (k_ + 1);
  }

  /// Vertices on crossed edges (three slots per node), then triangles cell by cell; both numbered by block.
  TriangleMesh marched() {
    std::vector<std::size_t> blocks(blocks_);
    for (std::size_t id = 0; id < block_of_.size(); ++id)
      if (block_of_[id] != kNone) blocks[static_cast<std::size_t>(block_of_[id])] = id;
    std::sort(blocks.begin(), blocks.end());

    vertex_.assign(values_.size() * 3, kNone);
    TriangleMesh mesh;
    for (const std::size_t id : blocks) add_vertices(id, mesh);
    for (const std::size_t id : blocks)
      if (active_[id]) add_triangles(id, mesh);
    // Vertices of edges that no visited cell uses are left behind.
    return submesh(mesh, std::vector<bool>(mesh.triangles.size(), true));
  }

  void add_vertices(std::size_t id, TriangleMesh& mesh) {
    const Index base = cell_at(id) * k_;
    for (int x = 0; x < k_; ++x)
      for (int y = 0; y < k_; ++y)
        for (int z = 0; z < k_; ++z) {
          const Index node = base + Index(x, y, z);
          const std::ptrdiff_t s = slot(node);
          const double here = values_[static_cast<std::size_t>(s)];
          for (int axis = 0; axis < 3; ++axis) {
            Index other = node;
            other[axis] += 1;
            const std::ptrdiff_t o = slot(other);
            // Beyond the box, and in cells that are not visited, all is outside.
            const double there = o == kNone ? 1.0 : values_[static_cast<std::size_t>(o)];
            if ((here < 0.0) == (there < 0.0)) continue;
            const double t = std::clamp(here / (here - there), kEndMargin, 1.0 - kEndMargin);
            vertex_[static_cast<std::size_t>(s) * 3 + static_cast<std::size_t>(axis)] =
                static_cast<std::int32_t>(mesh.vertices_mm.size());
            mesh.vertices_mm.push_back((1.0 - t) * position(node) + t * position(other));
          }
        }
  }

  void add_triangles(std::size_t id, TriangleMesh& mesh) const {
    const Index base = cell_at(id) * k_;
    for (int x = 0; x < k_; ++x)
      for (int y = 0; y < k_; ++y)
        for (int z = 0; z < k_; ++z) {
          const Index cube = base + Index(x, y, z);
          unsigned mask = 0;
          for (int n = 0; n < 8; ++n)
            if (inside(cube + Index(n & 1, n >> 1 & 1, n >> 2 & 1))) mask |= 1U << n;
          for (const auto& triangle : cube_table()[mask].triangles) {
            Triangle t{};
            for (std::size_t c = 0; c < 3; ++c) {
              const std::size_t e = triangle[c];
              const int n = cube_edges()[e][0];
              const std::ptrdiff_t s = slot(cube + Index(n & 1, n >> 1 & 1, n >> 2 & 1));
              t[c] = static_cast<std::uint32_t>(vertex_[static_cast<std::size_t>(s) * 3 + e / 4]);
            }
            mesh.triangles.push_back(t);
          }
        }
  }

  const ExtractionField& field_;
  const GridShape& coarse_;
  const int k_;
  const Index cells_;
  std::vector<std::int32_t> block_of_;
  std::vector<char> active_;
  std::size_t blocks_ = 0;
  std::vector<float> values_;
  std::vector<std::int32_t> vertex_;
};

}  // namespace

TriangleMesh extracted_surface(const ExtractionField& field, const GridShape& coarse, int refinement) {
  return Extractor(field, coarse, refinement).run();
}

LargestPiece largest_piece(const TriangleMesh& mesh) {
  LargestPiece out;
  std::size_t count = 0;
  const std::vector<std::uint32_t> piece = triangle_components(mesh, &count);
  if (count <= 1) {
    out.mesh = mesh;
    return out;
  }
  std::vector<double> volume(count, 0.0);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    volume[piece[t]] += mesh.corner(t, 0).dot(mesh.corner(t, 1).cross(mesh.corner(t, 2))) / 6.0;
  const std::size_t largest =
      static_cast<std::size_t>(std::max_element(volume.begin(), volume.end()) - volume.begin());
  for (std::size_t i = 0; i < count; ++i) {
    if (i == largest) continue;
    if (volume[i] < 0.0) {
      ++out.dropped_voids;
    } else {
      ++out.dropped_islands;
      out.largest_island_mm3 = std::max(out.largest_island_mm3, volume[i]);
    }
  }
  std::vector<bool> keep(mesh.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = piece[t] == largest;
  out.mesh = submesh(mesh, keep);
  return out;
}

}  // namespace gnathion
