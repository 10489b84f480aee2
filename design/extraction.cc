#include "design/extraction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "design/cube_table.h"
#include "design/parallel.h"

namespace gnathion {
namespace {

constexpr double kEndMargin =
    0.02;  // vertices keep this part of an edge from its ends: no degenerate triangles
constexpr double kReachSpacings =
    0.35;  // of the level from a cell's corners, at first; it is followed from there
constexpr int kNone = -1;

/// Calls body(x, y, z) for every node of a block of side k, z fastest.
template <class Body>
void each_node(int k, const Body& body) {
  for (int x = 0; x < k; ++x)
    for (int y = 0; y < k; ++y)
      for (int z = 0; z < k; ++z) body(x, y, z);
}

/// Fine samples in blocks of refinement³ nodes, one block per coarse cell that is needed.
class Extractor {
 public:
  Extractor(const ExtractionField& field, const GridShape& coarse, int refinement)
      : field_(field),
        coarse_(coarse),
        k_(refinement),
        block_size_(static_cast<std::size_t>(k_ * k_ * k_)),
        cells_(coarse.nodes - Eigen::Vector3i::Ones()),
        block_of_(static_cast<std::size_t>(cells_.x()) * static_cast<std::size_t>(cells_.y()) *
                      static_cast<std::size_t>(cells_.z()),
                  kNone),
        active_(block_of_.size(), 0) {}

  TriangleMesh run() {
    std::vector<std::size_t> wanted = initial_cells();
    while (!wanted.empty()) {
      make_exact_beside_level(activate(wanted));
      wanted = crossed_neighbours();
    }
    return marched();
  }

 private:
  using Index = Eigen::Vector3i;
  enum class Side : char { kInside, kOutside, kBoth };

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
  int in_block(int x, int y, int z) const { return (x * k_ + y) * k_ + z; }
  Vector3 position(const Index& node) const {
    return coarse_.origin_mm + (coarse_.spacing_mm / k_) * node.cast<double>();
  }

  /// The blocks of a cell and of the cells about it: first sample of each, or nothing where none is held.
  struct Neighbourhood {
    std::array<std::ptrdiff_t, 27> first;
    int k;
    /// Slot of the node (x, y, z) of the middle block, each within -k .. 2k - 1.
    std::ptrdiff_t slot(int x, int y, int z) const {
      const int bx = x < 0   ? 0
                     : x < k ? 1
                             : 2,
                by = y < 0   ? 0
                     : y < k ? 1
                             : 2,
                bz = z < 0   ? 0
                     : z < k ? 1
                             : 2;
      const std::ptrdiff_t base = first[static_cast<std::size_t>((bx * 3 + by) * 3 + bz)];
      if (base == kNone) return kNone;
      return base + ((x - (bx - 1) * k) * k + (y - (by - 1) * k)) * k + (z - (bz - 1) * k);
    }
  };
  Neighbourhood neighbourhood(const Index& cell) const {
    Neighbourhood n{{}, k_};
    std::size_t i = 0;
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y)
        for (int z = -1; z <= 1; ++z, ++i) {
          const Index c = cell + Index(x, y, z);
          const std::int32_t block = in_box(c) ? block_of_[cell_id(c)] : kNone;
          n.first[i] = block == kNone
                           ? kNone
                           : static_cast<std::ptrdiff_t>(static_cast<std::size_t>(block) * block_size_);
        }
    return n;
  }
  /// Whether no edge between a block's nodes, or from them to the blocks about it (those on its upper sides,
  /// or all that share a face with it), crosses the level.
  bool uniform(const Neighbourhood& near, bool faces_only) const {
    static constexpr std::array<std::size_t, 8> kUpper = {13, 14, 16, 17, 22, 23, 25, 26};
    static constexpr std::array<std::size_t, 7> kFaces = {13, 4, 10, 12, 14, 16, 22};
    const auto side = [&](std::size_t n) {
      return near.first[n] == kNone ? Side::kOutside
                                    : side_[static_cast<std::size_t>(near.first[n]) / block_size_];
    };
    const Side own = side(13);
    const auto same = [&](std::size_t n) { return side(n) == own; };
    if (own == Side::kBoth) return false;
    return faces_only ? std::all_of(kFaces.begin(), kFaces.end(), same)
                      : std::all_of(kUpper.begin(), kUpper.end(), same);
  }
  /// Copies of a block's samples with those about it, from node `low` (0 or -1) to k on each axis, z fastest.
  /// Beyond the box, and in cells that are not held, all is outside.
  std::vector<float> tile(const Neighbourhood& near, int low) const {
    const auto side = static_cast<std::size_t>(k_ + 1 - low);
    std::vector<float> out(side * side * side);
    float* to = out.data();
    const auto row = [&](std::size_t block, std::ptrdiff_t offset, int count) {
      if (near.first[block] == kNone)
        to = std::fill_n(to, count, 1.0f);
      else
        to = std::copy_n(&values_[static_cast<std::size_t>(near.first[block] + offset)], count, to);
    };
    for (int x = low; x <= k_; ++x)
      for (int y = low; y <= k_; ++y) {
        const int bx = x < 0 ? 0 : x < k_ ? 1 : 2, by = y < 0 ? 0 : y < k_ ? 1 : 2;
        const auto block = static_cast<std::size_t>((bx * 3 + by) * 3);
        const std::ptrdiff_t offset = ((x - (bx - 1) * k_) * k_ + (y - (by - 1) * k_)) * k_;
        if (low < 0) row(block, offset + k_ - 1, 1);
        row(block + 1, offset, k_);
        row(block + 2, offset, 1);
      }
    return out;
  }
  /// As in tile().
  float value(std::ptrdiff_t slot) const {
    return slot == kNone ? 1.0f : values_[static_cast<std::size_t>(slot)];
  }

  /// Coarse cells that the level may pass, by the estimate at their corners.
  std::vector<std::size_t> initial_cells() const {
    std::vector<float> corner(coarse_.size());
    parallel_each(coarse_.nodes.x(), [&](int i) {
      for (int j = 0; j < coarse_.nodes.y(); ++j)
        for (int k = 0; k < coarse_.nodes.z(); ++k)
          estimate_cell({i, j, k}, 1, &corner[coarse_.index(i, j, k)]);
    });
    const float reach = static_cast<float>(kReachSpacings * coarse_.spacing_mm);
    std::vector<char> passed(active_.size(), 0);
    parallel_each(passed.size(), [&](std::size_t id) {
      const Index c = cell_at(id);
      float low = 1e9f, high = -1e9f;
      for (int n = 0; n < 8; ++n) {
        const float v = corner[coarse_.index(c.x() + (n & 1), c.y() + (n >> 1 & 1), c.z() + (n >> 2 & 1))];
        low = std::min(low, v);
        high = std::max(high, v);
      }
      passed[id] = low <= reach && high >= -reach ? 1 : 0;
    });
    std::vector<std::size_t> out;
    for (std::size_t id = 0; id < passed.size(); ++id)
      if (passed[id]) out.push_back(id);
    return out;
  }

  /// Estimates at the nodes of a cell, k a side.
  void estimate_cell(const Index& cell, int k, float* values) const {
    if (field_.estimate_cell && in_box(cell)) return field_.estimate_cell(cell, k, values);
    const double step = coarse_.spacing_mm / k;
    const Vector3 low = coarse_.position(cell.x(), cell.y(), cell.z());
    each_node(k, [&](int x, int y, int z) {
      *values++ = static_cast<float>(field_.estimate(low + step * Vector3(x, y, z)));
    });
  }

  /// Adds blocks for the cells and for the nodes on their upper faces, and samples what is new. Returns the
  /// cells of the new blocks.
  std::vector<std::size_t> activate(const std::vector<std::size_t>& ids) {
    std::vector<std::size_t> fresh;
    for (const std::size_t id : ids) {
      active_[id] = 1;
      const Index c = cell_at(id);
      for (int n = 0; n < 8; ++n) {
        const Index d = c + Index(n & 1, n >> 1 & 1, n >> 2 & 1);
        if (!in_box(d)) continue;
        std::int32_t& block = block_of_[cell_id(d)];
        if (block != kNone) continue;
        block = static_cast<std::int32_t>(cell_of_block_.size());
        cell_of_block_.push_back(cell_id(d));
        fresh.push_back(cell_id(d));
      }
    }
    values_.resize(cell_of_block_.size() * block_size_);
    is_exact_.resize(values_.size(), 0);
    side_.resize(cell_of_block_.size(), Side::kBoth);
    parallel_each(fresh.size(), [&](std::size_t f) { sample_block(fresh[f]); });
    return fresh;
  }

  std::size_t first_slot(std::size_t cell) const {
    return static_cast<std::size_t>(block_of_[cell]) * block_size_;
  }

  void sample_block(std::size_t cell) {
    float* values = &values_[first_slot(cell)];
    estimate_cell(cell_at(cell), k_, values);
    std::vector<int> ask;
    for (int i = 0; i < static_cast<int>(block_size_); ++i)
      if (std::abs(values[i]) < field_.sure_mm) ask.push_back(i);
    make_exact(cell, ask);
    note_side(cell);
  }

  /// Whether a block lies on one side as a whole.
  void note_side(std::size_t cell) {
    const float* values = &values_[first_slot(cell)];
    std::size_t in = 0;
    for (std::size_t i = 0; i < block_size_; ++i) in += values[i] < 0.0f ? 1 : 0;
    side_[static_cast<std::size_t>(block_of_[cell])] = in == 0             ? Side::kOutside
                                                       : in == block_size_ ? Side::kInside
                                                                           : Side::kBoth;
  }

  void make_exact(std::size_t cell, const std::vector<int>& nodes) {
    if (nodes.empty()) return;
    const Index base = cell_at(cell) * k_;
    const std::size_t first = first_slot(cell);
    std::vector<Vector3> points;
    for (const int i : nodes) points.push_back(position(base + Index(i / k_ / k_, i / k_ % k_, i % k_)));
    std::vector<double> values(points.size());
    field_.exact(points, values);
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      values_[first + static_cast<std::size_t>(nodes[n])] = static_cast<float>(values[n]);
      is_exact_[first + static_cast<std::size_t>(nodes[n])] = 1;
    }
  }

  /// Estimates in the block that have a neighbour on the other side of the level.
  std::vector<int> estimates_beside_level(std::size_t cell) const {
    const Neighbourhood near = neighbourhood(cell_at(cell));
    std::vector<int> out;
    if (uniform(near, true)) return out;
    const std::vector<float> around = tile(near, -1);
    const std::ptrdiff_t side = k_ + 2;
    const std::size_t first = first_slot(cell);
    each_node(k_, [&](int x, int y, int z) {
      if (is_exact_[first + static_cast<std::size_t>(in_block(x, y, z))]) return;
      const float* here = &around[static_cast<std::size_t>(((x + 1) * side + y + 1) * side + z + 1)];
      const bool in = *here < 0.0f;
      const auto crossed = [&](std::ptrdiff_t step) {
        return (here[step] < 0.0f) != in || (here[-step] < 0.0f) != in;
      };
      if (crossed(side * side) || crossed(side) || crossed(1)) out.push_back(in_block(x, y, z));
    });
    return out;
  }

  /// Both ends of every crossed edge get exact values; that may move the crossing, so the neighbours are
  /// looked at again.
  void make_exact_beside_level(const std::vector<std::size_t>& fresh) {
    std::vector<std::size_t> look = with_neighbours(fresh);
    while (!look.empty()) {
      std::vector<std::vector<int>> ask(look.size());
      parallel_each(look.size(), [&](std::size_t i) { ask[i] = estimates_beside_level(look[i]); });
      parallel_each(look.size(), [&](std::size_t i) {
        make_exact(look[i], ask[i]);
        if (!ask[i].empty()) note_side(look[i]);
      });
      std::vector<std::size_t> changed;
      for (std::size_t i = 0; i < look.size(); ++i)
        if (!ask[i].empty()) changed.push_back(look[i]);
      look = with_neighbours(changed);
    }
  }

  /// The cells and those that share a face with them, where blocks are held.
  std::vector<std::size_t> with_neighbours(const std::vector<std::size_t>& cells) const {
    std::vector<std::size_t> out = cells;
    for (const std::size_t id : cells)
      for (int n = 0; n < 6; ++n) {
        Index c = cell_at(id);
        c[n / 2] += n % 2 ? 1 : -1;
        if (in_box(c) && block_of_[cell_id(c)] != kNone) out.push_back(cell_id(c));
      }
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
  }

  /// Cells beyond a face of an active cell that the level crosses.
  std::vector<std::size_t> crossed_neighbours() const {
    std::vector<unsigned char> sides(cell_of_block_.size(), 0);
    parallel_each(cell_of_block_.size(), [&](std::size_t block) {
      if (active_[cell_of_block_[block]]) sides[block] = crossed_sides(cell_at(cell_of_block_[block]));
    });
    std::vector<std::size_t> out;
    for (std::size_t block = 0; block < sides.size(); ++block)
      for (int n = 0; n < 6; ++n) {
        if ((sides[block] >> n & 1) == 0) continue;
        Index c = cell_at(cell_of_block_[block]);
        c[n / 2] += n % 2 ? 1 : -1;
        out.push_back(cell_id(c));
      }
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
  }

  /// Bit 2·axis + side for each face of the cell that the level crosses and beyond which no cell is active.
  unsigned char crossed_sides(const Index& cell) const {
    const Neighbourhood near = neighbourhood(cell);
    unsigned char out = 0;
    if (uniform(near, false)) return out;
    for (int n = 0; n < 6; ++n) {
      Index beyond = cell;
      beyond[n / 2] += n % 2 ? 1 : -1;
      if (!in_box(beyond) || active_[cell_id(beyond)]) continue;
      if (face_crossed(near, n / 2, n % 2)) out = static_cast<unsigned char>(out | 1 << n);
    }
    return out;
  }

  bool face_crossed(const Neighbourhood& near, int axis, int side) const {
    int in = 0;
    for (int a = 0; a <= k_; ++a)
      for (int b = 0; b <= k_; ++b) {
        Index node;
        node[axis] = side ? k_ : 0;
        node[(axis + 1) % 3] = a;
        node[(axis + 2) % 3] = b;
        in += value(near.slot(node.x(), node.y(), node.z())) < 0.0f ? 1 : 0;
      }
    return in != 0 && in != (k_ + 1) * (k_ + 1);
  }

  /// Vertices on crossed edges (three slots per node), then triangles cell by cell; both numbered by the
  /// place of their block.
  TriangleMesh marched() {
    std::vector<std::size_t> cells = cell_of_block_;
    std::sort(cells.begin(), cells.end());
    vertex_.assign(values_.size() * 3, kNone);
    const auto vertices_of = [&](std::size_t i, std::vector<Vector3>* out, std::size_t start) {
      return march_edges(cells[i], out, start);
    };
    const auto triangles_of = [&](std::size_t i, std::vector<Triangle>* out, std::size_t start) {
      return active_[cells[i]] ? march_cubes(cells[i], out, start) : 0;
    };
    TriangleMesh mesh;
    fill_in_order(cells.size(), vertices_of, mesh.vertices_mm);
    fill_in_order(cells.size(), triangles_of, mesh.triangles);
    // Vertices of edges that no visited cell uses are left behind.
    return submesh(mesh, std::vector<bool>(mesh.triangles.size(), true));
  }

  /// Counts, then writes: piece(i, nullptr, 0) tells how many items i has, piece(i, &out, start) puts them
  /// there.
  template <class Item, class Piece>
  static void fill_in_order(std::size_t count, const Piece& piece, std::vector<Item>& out) {
    std::vector<std::size_t> start(count + 1, 0);
    parallel_each(count, [&](std::size_t i) { start[i + 1] = piece(i, nullptr, 0); });
    for (std::size_t i = 0; i < count; ++i) start[i + 1] += start[i];
    out.resize(start.back());
    parallel_each(count, [&](std::size_t i) { piece(i, &out, start[i]); });
  }

  std::size_t march_edges(std::size_t cell, std::vector<Vector3>* out, std::size_t start) {
    const Index base = cell_at(cell) * k_;
    const Neighbourhood near = neighbourhood(cell_at(cell));
    std::size_t count = 0;
    if (uniform(near, false)) return count;
    const std::vector<float> around = tile(near, 0);
    const std::size_t side = static_cast<std::size_t>(k_) + 1;
    const std::array<std::size_t, 3> step = {side * side, side, 1};
    const std::size_t first = first_slot(cell);
    each_node(k_, [&](int x, int y, int z) {
      const std::size_t at = static_cast<std::size_t>(x) * step[0] + static_cast<std::size_t>(y) * side +
                             static_cast<std::size_t>(z);
      const double here = around[at];
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double there = around[at + step[axis]];
        if ((here < 0.0) == (there < 0.0)) continue;
        const std::size_t number = start + count++;
        if (!out) continue;
        Index other(x, y, z);
        other[static_cast<int>(axis)] += 1;
        const double t = std::clamp(here / (here - there), kEndMargin, 1.0 - kEndMargin);
        vertex_[(first + static_cast<std::size_t>(in_block(x, y, z))) * 3 + axis] =
            static_cast<std::int32_t>(number);
        (*out)[number] = (1.0 - t) * position(base + Index(x, y, z)) + t * position(base + other);
      }
    });
    return count;
  }

  std::size_t march_cubes(std::size_t cell, std::vector<Triangle>* out, std::size_t start) const {
    const Neighbourhood near = neighbourhood(cell_at(cell));
    std::size_t count = 0;
    if (uniform(near, false)) return count;
    const std::vector<float> around = tile(near, 0);
    const int side = k_ + 1;
    std::array<int, 8> step{};
    for (int n = 0; n < 8; ++n)
      step[static_cast<std::size_t>(n)] = (n & 1) * side * side + (n >> 1 & 1) * side + (n >> 2 & 1);
    each_node(k_, [&](int x, int y, int z) {
      const float* here = &around[static_cast<std::size_t>((x * side + y) * side + z)];
      unsigned mask = 0;
      for (unsigned n = 0; n < 8; ++n)
        if (here[step[n]] < 0.0f) mask |= 1U << n;
      if (mask == 0 || mask == 255) return;
      const auto& triangles = cube_table()[mask].triangles;
      if (out)
        for (std::size_t i = 0; i < triangles.size(); ++i)
          for (std::size_t c = 0; c < 3; ++c) {
            const std::size_t e = triangles[i][c];
            const int n = cube_edges()[e][0];
            const auto slot =
                static_cast<std::size_t>(near.slot(x + (n & 1), y + (n >> 1 & 1), z + (n >> 2 & 1)));
            (*out)[start + count + i][c] = static_cast<std::uint32_t>(vertex_[slot * 3 + e / 4]);
          }
      count += triangles.size();
    });
    return count;
  }

  const ExtractionField& field_;
  const GridShape& coarse_;
  const int k_;
  const std::size_t block_size_;
  const Index cells_;
  std::vector<std::int32_t> block_of_;  ///< of each cell
  std::vector<std::size_t> cell_of_block_;
  std::vector<char> active_;  ///< cells that are marched
  std::vector<float> values_;
  std::vector<char> is_exact_;
  std::vector<Side> side_;  ///< of each block
  std::vector<std::int32_t> vertex_;
};

}  // namespace

std::function<void(const std::vector<Vector3>&, std::vector<double>&)> pointwise(
    std::function<double(const Vector3&)> f) {
  return [f = std::move(f)](const std::vector<Vector3>& points, std::vector<double>& values) {
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = f(points[i]);
  };
}

TriangleMesh extracted_surface(const ExtractionField& field, const GridShape& coarse, int refinement) {
  return Extractor(field, coarse, refinement).run();
}

LargestPiece largest_piece(const TriangleMesh& mesh, std::size_t pieces) {
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
  std::vector<std::size_t> by_volume(count);
  std::iota(by_volume.begin(), by_volume.end(), std::size_t{0});
  std::stable_sort(by_volume.begin(), by_volume.end(),
                   [&](std::size_t a, std::size_t b) { return volume[a] > volume[b]; });
  std::vector<bool> kept(count, false);
  for (std::size_t n = 0; n < std::min(pieces, count); ++n) kept[by_volume[n]] = volume[by_volume[n]] > 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    if (kept[i]) continue;
    if (volume[i] < 0.0) {
      ++out.dropped_voids;
    } else {
      ++out.dropped_islands;
      out.largest_island_mm3 = std::max(out.largest_island_mm3, volume[i]);
    }
  }
  std::vector<bool> keep(mesh.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = kept[piece[t]];
  out.mesh = submesh(mesh, keep);
  return out;
}

}  // namespace gnathion
