#include "evaluation/box_tree.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "evaluation/space_curve.h"

#if defined(__SSE__)
#include <xmmintrin.h>
#endif

namespace gnathion {
namespace {

// Single precision loses at most this part of a length; boxes and bounds are widened by it.
constexpr double kSlack = 4e-7;
constexpr double kRough = 1e-4;  // mm, and part of the distance: slack of rough distances
constexpr float kFar = 1e30f;
constexpr double kFarthest = 1e9;

/// Four floats side by side; both compilers turn its arithmetic into one instruction.
using Four = float __attribute__((vector_size(16)));

inline Four four(const float* v) {
  Four f;
  std::memcpy(&f, v, sizeof f);
  return f;
}
#if defined(__SSE__)  // the compilers do not find these instructions by themselves
inline Four larger(Four a, Four b) {
  return _mm_max_ps(a, b);
}
inline Four smaller(Four a, Four b) {
  return _mm_min_ps(a, b);
}
inline int which_at_most(Four a, Four b) {
  return _mm_movemask_ps(_mm_cmple_ps(a, b));
}
#else
inline Four larger(Four a, Four b) {
  return a > b ? a : b;
}
inline Four smaller(Four a, Four b) {
  return a < b ? a : b;
}
inline int which_at_most(Four a, Four b) {
  return (a[0] <= b[0]) | (a[1] <= b[1]) << 1 | (a[2] <= b[2]) << 2 | (a[3] <= b[3]) << 3;
}
#endif
inline Four all(float v) {
  return Four{v, v, v, v};
}
struct Four3 {
  Four x, y, z;
  Four dot(const Four3& b) const { return x * b.x + y * b.y + z * b.z; }
  /// |this − s·b|²
  Four squared_without(Four s, const Four3& b) const {
    const Four3 r{x - s * b.x, y - s * b.y, z - s * b.z};
    return r.dot(r);
  }
};
inline Four3 four3(const float (*v)[4]) {
  return {four(v[0]), four(v[1]), four(v[2])};
}
/// A point, four times over.
struct Place {
  Four x, y, z;
  explicit Place(const Vector3& p)
      : x(all(static_cast<float>(p.x()))),
        y(all(static_cast<float>(p.y()))),
        z(all(static_cast<float>(p.z()))) {}
  /// Squared distances to four boxes.
  Four squared_to(const float (&low)[3][4], const float (&high)[3][4]) const {
    const Four zero = all(0.0f);
    const Four dx = larger(larger(four(low[0]) - x, x - four(high[0])), zero);
    const Four dy = larger(larger(four(low[1]) - y, y - four(high[1])), zero);
    const Four dz = larger(larger(four(low[2]) - z, z - four(high[2])), zero);
    return dx * dx + dy * dy + dz * dz;
  }
};
inline Four part(Four numerator, Four denominator) {
  return smaller(larger(numerator / larger(denominator, all(1e-30f)), all(0.0f)), all(1.0f));
}

/// Squared distances from a point to four triangles, to about 1e-5 of the distance to their corners; 0 for
/// slivers (an angle under 6° at the first corner), which single precision cannot judge.
Four rough_squared_distances(const Four3& ap, const Four3& ab, const Four3& ac) {
  const Four aa = ab.dot(ab), bb = ab.dot(ac), cc = ac.dot(ac), d = ab.dot(ap), e = ac.dot(ap);
  const Four det = aa * cc - bb * bb;
  const Four3 bc{ac.x - ab.x, ac.y - ab.y, ac.z - ab.z}, bp{ap.x - ab.x, ap.y - ab.y, ap.z - ab.z};
  const Four on_sides =
      smaller(smaller(ap.squared_without(part(d, aa), ab), ap.squared_without(part(e, cc), ac)),
              bp.squared_without(part(bc.dot(bp), bc.dot(bc)), bc));
  const Four v = cc * d - bb * e, w = aa * e - bb * d;
  const Four safe = larger(det, all(1e-30f));
  const Four sv = v / safe, sw = w / safe;
  const Four3 r{ap.x - sv * ab.x - sw * ac.x, ap.y - sv * ab.y - sw * ac.y, ap.z - sv * ab.z - sw * ac.z};
  const Four zero = all(0.0f);
  const Four best = ((v > zero) & (w > zero) & (v + w < det)) ? r.dot(r) : on_sides;
  return det < all(0.01f) * aa * cc ? zero : best;
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
  leaves_.resize((count + 3) / 4, Leaf{});
  for (std::size_t i = 0; i < count; ++i) {
    const Vector3 a = mesh.corner(order_[i], 0);
    const Vector3 ab = mesh.corner(order_[i], 1) - a, ac = mesh.corner(order_[i], 2) - a,
                  local = a - centre_mm_;
    for (int k = 0; k < 3; ++k) {
      leaves_[i / 4].a[k][i % 4] = static_cast<float>(local[k]);
      leaves_[i / 4].ab[k][i % 4] = static_cast<float>(ab[k]);
      leaves_[i / 4].ac[k][i % 4] = static_cast<float>(ac[k]);
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

void BoxTree::gather(const Vector3& centre_mm, double radius_mm, Entries& entries) const {
  entries.nodes.clear();
  if (nodes_.empty()) return;
  entries.level = static_cast<std::uint32_t>(level_begin_.size() - 1);
  entries.nodes.push_back(0);
  const Vector3 local = centre_mm - centre_mm_;
  const double widened = radius_mm * (1.0 + 2.0 * kSlack) + kSlack * (local.norm() + radius_mm_);
  const Four limit = all(static_cast<float>(widened * widened));
  const Place at(local);
  std::vector<std::uint32_t> below;
  while (entries.level > 0) {
    below.clear();
    for (const std::uint32_t n : entries.nodes) {
      const Node& node = nodes_[level_begin_[entries.level] + n];
      const int near = which_at_most(at.squared_to(node.low, node.high), limit);
      for (std::uint32_t c = 0; c < 4; ++c)
        if (near >> c & 1) below.push_back(4 * n + c);
    }
    if (below.size() > kMostEntries) return;
    entries.nodes.swap(below);
    --entries.level;
  }
}

bool BoxTree::closest(const TriangleMesh& mesh, const Vector3& p_mm, double reach_mm, Search& search,
                      const Entries* entries) const {
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
  // What can still matter: a box must come as near as `limit`, a roughly known distance as `rough_limit`.
  float limit = 0.0f, rough_limit = 0.0f;
  const auto tighten = [&] {
    const double r = std::sqrt(search.best.squared_distance), widened = r * (1.0 + 2.0 * kSlack) + slack;
    limit = static_cast<float>(widened * widened);
    const double rough = r * (1.0 + kRough) + kRough + slack;
    rough_limit = static_cast<float>(rough * rough);
  };
  tighten();
  const Place at(local);

  struct Entry {
    float squared;
    std::uint32_t level, index;
  };
  Entry stack[4 * 20 + kMostEntries];
  int depth = 0;
  if (entries == nullptr) {
    stack[depth++] = {0.0f, static_cast<std::uint32_t>(level_begin_.size() - 1), 0};
  } else {
    for (const std::uint32_t n : entries->nodes) stack[depth++] = {0.0f, entries->level, n};
  }
  while (depth > 0) {
    const Entry e = stack[--depth];
    if (e.squared > limit) continue;
    const Node& node = nodes_[level_begin_[e.level] + e.index];
    const Four squared = at.squared_to(node.low, node.high);
    const int near = which_at_most(squared, all(limit));
    if (near == 0) continue;
    if (e.level > 0) {
      // The nearest last, so that it is taken first.
      const int begin = depth;
      for (std::uint32_t c = 0; c < 4; ++c) {
        if ((near >> c & 1) == 0) continue;
        stack[depth++] = {squared[c], e.level - 1, 4 * e.index + c};
        if (depth - 2 >= begin && stack[depth - 2].squared < squared[c])
          std::swap(stack[depth - 2], stack[depth - 1]);
      }
      continue;
    }
    const Leaf& leaf = leaves_[e.index];
    Four3 ap = four3(leaf.a);
    ap = {at.x - ap.x, at.y - ap.y, at.z - ap.z};
    const Four rough = rough_squared_distances(ap, four3(leaf.ab), four3(leaf.ac));
    const int candidates = near & which_at_most(rough, all(rough_limit));
    for (std::uint32_t c = 0; candidates >> c != 0; ++c) {
      if ((candidates >> c & 1) == 0 || rough[c] > rough_limit) continue;
      const std::uint32_t t = order_[4 * e.index + c];
      if (t == first) continue;
      try_triangle(t);
      tighten();
    }
  }
  if (search.triangle != Search::kNone) return true;
  search.triangle = first;
  return false;
}

}  // namespace gnathion
