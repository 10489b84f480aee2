#include "evaluation/box_tree.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "evaluation/space_curve.h"

namespace gnathion {
namespace {

// Single precision loses at most this part of a length; boxes and bounds are widened by it.
constexpr double kSlack = 4e-7;
constexpr float kFar = 1e30f;
constexpr double kFarthest = 1e9;

/// Four floats side by side; both compilers turn its arithmetic into one instruction.
using Four = float __attribute__((vector_size(16)));

inline Four four(const float* v) {
  Four f;
  std::memcpy(&f, v, sizeof f);
  return f;
}
inline Four larger(Four a, Four b) {
  return a > b ? a : b;
}

}  // namespace

BoxTree::BoxTree(const TriangleMesh& mesh) {
  const std::size_t count = mesh.triangles.size();
  if (count == 0) return;
  const Box box = bounding_box(mesh);
  centre_mm_ = box.centre_mm();
  radius_mm_ = 0.5 * box.size_mm().norm();
  std::vector<Vector3> middles(count);
  for (std::size_t i = 0; i < count; ++i)
    middles[i] = (mesh.corner(i, 0) + mesh.corner(i, 1) + mesh.corner(i, 2)) / 3.0;
  order_ = hilbert_order(middles);

  // Boxes of the children of the level that is being built.
  const auto slack = static_cast<float>(kSlack * radius_mm_);
  std::vector<std::array<float, 6>> children(count);
  for (std::size_t i = 0; i < count; ++i) {
    Box b;
    for (int k = 0; k < 3; ++k) b.extend(mesh.corner(order_[i], k) - centre_mm_);
    for (int k = 0; k < 3; ++k) {
      children[i][k] = static_cast<float>(b.min_mm[k]) - slack;
      children[i][k + 3] = static_cast<float>(b.max_mm[k]) + slack;
    }
  }
  while (true) {
    level_begin_.push_back(nodes_.size());
    std::vector<std::array<float, 6>> parents((children.size() + 3) / 4);
    for (std::size_t p = 0; p < parents.size(); ++p) {
      Node node;
      parents[p] = {kFar, kFar, kFar, -kFar, -kFar, -kFar};
      for (std::size_t c = 0; c < 4; ++c) {
        const bool present = 4 * p + c < children.size();
        for (int k = 0; k < 3; ++k) {
          // An absent child is a box at infinity.
          node.low[k][c] = present ? children[4 * p + c][k] : kFar;
          node.high[k][c] = present ? children[4 * p + c][k + 3] : kFar;
          if (!present) continue;
          parents[p][k] = std::min(parents[p][k], node.low[k][c]);
          parents[p][k + 3] = std::max(parents[p][k + 3], node.high[k][c]);
        }
      }
      nodes_.push_back(node);
    }
    if (parents.size() == 1) break;
    children = std::move(parents);
  }
}

bool BoxTree::closest(const TriangleMesh& mesh, const Vector3& p_mm, double reach_mm, Search& search) const {
  if (nodes_.empty()) return false;
  const std::uint32_t first = search.triangle;
  search.triangle = Search::kNone;
  search.best.squared_distance = std::pow(std::min(reach_mm, kFarthest), 2);
  const auto try_triangle = [&](std::uint32_t t) {
    const TrianglePoint found =
        closest_on_triangle(p_mm, mesh.corner(t, 0), mesh.corner(t, 1), mesh.corner(t, 2));
    if (found.squared_distance > search.best.squared_distance) return;
    if (found.squared_distance == search.best.squared_distance && t > search.triangle) return;
    search.best = found;
    search.triangle = t;
  };
  if (first != Search::kNone) try_triangle(first);

  const Vector3 local = p_mm - centre_mm_;
  const double slack = kSlack * (local.norm() + radius_mm_);
  const auto bound = [&] {
    const double r = std::sqrt(search.best.squared_distance) * (1.0 + kSlack) + slack;
    return static_cast<float>(r * r * (1.0 + 4.0 * kSlack));
  };
  float limit = bound();
  const Eigen::Vector3f q = local.cast<float>();
  const Four zero = {0, 0, 0, 0};
  const Four at[3] = {
      {q.x(), q.x(), q.x(), q.x()}, {q.y(), q.y(), q.y(), q.y()}, {q.z(), q.z(), q.z(), q.z()}};

  struct Entry {
    float squared;
    std::uint32_t level, index;
  };
  Entry stack[4 * 20];
  int depth = 0;
  stack[depth++] = {0.0f, static_cast<std::uint32_t>(level_begin_.size() - 1), 0};
  while (depth > 0) {
    const Entry e = stack[--depth];
    if (e.squared > limit) continue;
    const Node& node = nodes_[level_begin_[e.level] + e.index];
    Four squared = zero;
    for (int k = 0; k < 3; ++k) {
      const Four apart = larger(larger(four(node.low[k]) - at[k], at[k] - four(node.high[k])), zero);
      squared += apart * apart;
    }
    // Nearest last, so that it is taken first.
    Entry hits[4];
    int n = 0;
    for (std::uint32_t c = 0; c < 4; ++c) {
      if (!(squared[c] <= limit)) continue;
      int i = n++;
      for (; i > 0 && hits[i - 1].squared < squared[c]; --i) hits[i] = hits[i - 1];
      hits[i] = {squared[c], e.level - 1, 4 * e.index + c};
    }
    if (e.level > 0) {
      for (int i = 0; i < n; ++i) stack[depth++] = hits[i];
      continue;
    }
    for (int i = n - 1; i >= 0; --i) {
      if (hits[i].squared > limit) continue;
      const std::uint32_t t = order_[hits[i].index];
      if (t == first) continue;
      try_triangle(t);
      limit = bound();
    }
  }
  if (search.triangle != Search::kNone) return true;
  search.triangle = first;
  return false;
}

}  // namespace gnathion
