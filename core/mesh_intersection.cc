// Which triangles of one or two meshes meet. A balanced tree of boxes finds the candidates, exact predicates
// decide (triangle_intersection.h). Leaves are worked on in parallel, each into its own list, so that the
// result does not depend on the number of threads.
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <bit>
#include <numeric>

#include "core/mesh_edges.h"
#include "core/mesh_query.h"
#include "core/triangle_intersection.h"

namespace gnathion {
namespace {

using Pair = std::array<std::uint32_t, 2>;

/// In single precision. Rounding keeps order (a ≤ b rounds to a' ≤ b'), so boxes that meet still meet.
struct FloatBox {
  std::array<float, 3> low{}, high{};

  static FloatBox none() {
    FloatBox box;
    box.low.fill(std::numeric_limits<float>::infinity());
    box.high.fill(-std::numeric_limits<float>::infinity());
    return box;
  }
  void extend(const Vector3& p) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto rounded = static_cast<float>(p[static_cast<int>(k)]);
      low[k] = std::min(low[k], rounded);
      high[k] = std::max(high[k], rounded);
    }
  }
  void extend(const FloatBox& other) {
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], other.low[k]);
      high[k] = std::max(high[k], other.high[k]);
    }
  }
  bool meets(const FloatBox& o) const {
    return low[0] <= o.high[0] && o.low[0] <= high[0] && low[1] <= o.high[1] && o.low[1] <= high[1] &&
           low[2] <= o.high[2] && o.low[2] <= high[2];
  }
};

/// A complete binary tree over a mesh's triangles that have area. Node k has the children 2k and 2k+1, the
/// root is 1; leaf i holds the i-th of equal shares of the triangles.
class BoxTree {
 public:
  explicit BoxTree(const TriangleMesh& mesh) : mesh_(mesh) {
    boxes_of_triangles(mesh);
    while (leaves_ * kLeafTriangles < order_.size()) leaves_ *= 2;
    nodes_.assign(2 * leaves_, FloatBox::none());
    build(1, 0, leaves_);
    boxes_.clear();
    boxes_.shrink_to_fit();
  }

  std::size_t leaves() const { return leaves_; }
  const FloatBox& leaf_box(std::size_t leaf) const { return nodes_[leaves_ + leaf]; }
  std::size_t begin(std::size_t leaf) const { return leaf * order_.size() / leaves_; }
  std::uint32_t triangle(std::size_t place) const { return order_[place]; }
  const FloatBox& box(std::size_t place) const { return placed_[place]; }
  std::array<Vector3, 3> corners(std::size_t place) const {
    const std::uint32_t t = order_[place];
    return {mesh_.corner(t, 0), mesh_.corner(t, 1), mesh_.corner(t, 2)};
  }

  /// Calls visit(leaf) for the leaves from `first` on whose boxes meet `box`, until it returns false.
  template <class Visit>
  void for_each_leaf(const FloatBox& box, std::size_t first, Visit&& visit) const {
    std::array<std::size_t, 128> stack;
    std::size_t top = 0;
    stack[top++] = 1;
    while (top > 0) {
      const std::size_t node = stack[--top];
      if (!nodes_[node].meets(box)) continue;
      if (node >= leaves_) {
        if (node - leaves_ >= first && !visit(node - leaves_)) return;
        continue;
      }
      // The last leaf beneath a node tells whether any of its leaves is wanted.
      for (const std::size_t child : {2 * node + 1, 2 * node})
        if (last_leaf(child) >= first) stack[top++] = child;
    }
  }

 private:
  static constexpr std::size_t kLeafTriangles = 4;

  void boxes_of_triangles(const TriangleMesh& mesh) {
    boxes_.assign(mesh.triangles.size(), FloatBox::none());
    std::vector<std::uint8_t> useful(mesh.triangles.size());
    tbb::parallel_for(std::size_t{0}, mesh.triangles.size(), [&](std::size_t i) {
      const Vector3 a = mesh.corner(i, 0), b = mesh.corner(i, 1), c = mesh.corner(i, 2);
      useful[i] = !has_repeated_index(mesh.triangles[i]) && !is_degenerate(a, b, c);
      for (const Vector3& p : {a, b, c}) boxes_[i].extend(p);
    });
    for (std::uint32_t i = 0; i < useful.size(); ++i)
      if (useful[i]) order_.push_back(i);
    placed_.resize(order_.size());
  }

  std::size_t last_leaf(std::size_t node) const {
    const auto levels_below = static_cast<std::size_t>(std::bit_width(leaves_) - std::bit_width(node));
    return ((node + 1) << levels_below) - 1 - leaves_;
  }

  /// Splits the leaves' triangles at the median along the longest axis of their middles.
  void build(std::size_t node, std::size_t first_leaf, std::size_t end_leaf) {
    const std::size_t from = begin(first_leaf), to = begin(end_leaf);
    if (end_leaf - first_leaf == 1) {
      for (std::size_t i = from; i < to; ++i) {
        placed_[i] = boxes_[order_[i]];
        nodes_[node].extend(placed_[i]);
      }
      return;
    }
    const auto middle_of = [this](std::uint32_t t, std::size_t k) {
      return boxes_[t].low[k] + boxes_[t].high[k];
    };
    std::array<float, 3> low, high;
    low.fill(std::numeric_limits<float>::infinity());
    high.fill(-std::numeric_limits<float>::infinity());
    for (std::size_t i = from; i < to; ++i)
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], middle_of(order_[i], k));
        high[k] = std::max(high[k], middle_of(order_[i], k));
      }
    std::size_t axis = 0;
    for (std::size_t k = 1; k < 3; ++k)
      if (high[k] - low[k] > high[axis] - low[axis]) axis = k;
    const std::size_t middle_leaf = (first_leaf + end_leaf) / 2;
    std::nth_element(order_.begin() + static_cast<std::ptrdiff_t>(from),
                     order_.begin() + static_cast<std::ptrdiff_t>(begin(middle_leaf)),
                     order_.begin() + static_cast<std::ptrdiff_t>(to), [&](std::uint32_t a, std::uint32_t b) {
                       const float ma = middle_of(a, axis), mb = middle_of(b, axis);
                       return ma != mb ? ma < mb : a < b;
                     });
    const auto left = [&] { build(2 * node, first_leaf, middle_leaf); };
    const auto right = [&] { build(2 * node + 1, middle_leaf, end_leaf); };
    if (to - from > 4096) {
      tbb::parallel_invoke(left, right);
    } else {
      left();
      right();
    }
    nodes_[node].extend(nodes_[2 * node]);
    nodes_[node].extend(nodes_[2 * node + 1]);
  }

  const TriangleMesh& mesh_;
  std::size_t leaves_ = 1;
  std::vector<std::uint32_t> order_;  // triangles by leaf
  std::vector<FloatBox> boxes_;       // by triangle, while building
  std::vector<FloatBox> placed_;      // by place in order_
  std::vector<FloatBox> nodes_;
};

/// Works through the leaves in blocks, so that a small limit ends the work early at the same place always.
template <class PairsOfLeaf>
std::vector<Pair> collect(std::size_t leaves, std::size_t limit, PairsOfLeaf&& pairs_of_leaf) {
  constexpr std::size_t kBlock = 8192;
  std::vector<Pair> all;
  std::vector<std::vector<Pair>> found(std::min(leaves, kBlock));
  for (std::size_t block = 0; block < leaves && all.size() < limit; block += kBlock) {
    const std::size_t end = std::min(leaves, block + kBlock);
    tbb::parallel_for(block, end, [&](std::size_t leaf) { pairs_of_leaf(leaf, found[leaf - block]); });
    for (std::size_t i = 0; i < end - block; ++i) {
      all.insert(all.end(), found[i].begin(), found[i].end());
      found[i].clear();
    }
  }
  std::sort(all.begin(), all.end());
  if (all.size() > limit) all.resize(limit);
  return all;
}

}  // namespace

std::vector<Pair> self_intersections(const TriangleMesh& mesh, std::size_t limit) {
  if (limit == 0) return {};
  const BoxTree tree(mesh);
  const std::vector<std::uint32_t> same = first_equal_vertices(mesh.vertices_mm);
  const auto ids = [&](std::size_t place) -> Triangle {
    const Triangle& t = mesh.triangles[tree.triangle(place)];
    return {same[t[0]], same[t[1]], same[t[2]]};
  };
  return collect(tree.leaves(), limit, [&](std::size_t leaf, std::vector<Pair>& pairs) {
    tree.for_each_leaf(tree.leaf_box(leaf), leaf, [&](std::size_t other) {
      for (std::size_t i = tree.begin(leaf); i < tree.begin(leaf + 1); ++i) {
        for (std::size_t j = other == leaf ? i + 1 : tree.begin(other); j < tree.begin(other + 1); ++j) {
          if (!tree.box(i).meets(tree.box(j))) continue;
          if (!triangles_intersect(tree.corners(i), ids(i), tree.corners(j), ids(j))) continue;
          const std::uint32_t s = tree.triangle(i), t = tree.triangle(j);
          pairs.push_back({std::min(s, t), std::max(s, t)});
        }
      }
      return pairs.size() < limit;
    });
  });
}

std::vector<Pair> intersections(const TriangleMesh& a, const TriangleMesh& b, std::size_t limit) {
  if (limit == 0) return {};
  const BoxTree tree_a(a), tree_b(b);
  // Two meshes have no vertices in common, wherever these are.
  constexpr Triangle kIdsOfA{0, 1, 2}, kIdsOfB{3, 4, 5};
  return collect(tree_a.leaves(), limit, [&](std::size_t leaf, std::vector<Pair>& pairs) {
    tree_b.for_each_leaf(tree_a.leaf_box(leaf), 0, [&](std::size_t other) {
      for (std::size_t i = tree_a.begin(leaf); i < tree_a.begin(leaf + 1); ++i)
        for (std::size_t j = tree_b.begin(other); j < tree_b.begin(other + 1); ++j)
          if (tree_a.box(i).meets(tree_b.box(j)) &&
              triangles_intersect(tree_a.corners(i), kIdsOfA, tree_b.corners(j), kIdsOfB))
            pairs.push_back({tree_a.triangle(i), tree_b.triangle(j)});
      return pairs.size() < limit;
    });
  });
}

}  // namespace gnathion
