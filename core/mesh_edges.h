// The edges of a triangle mesh with the triangles on each: what topology questions are answered from.
#pragma once

#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

/// One triangle's use of an edge: its k-th side runs from corner k to corner k+1.
struct EdgeUse {
  std::uint32_t high = 0;  ///< the edge's higher vertex; the lower one names the bucket
  std::uint32_t triangle = 0;
  std::uint8_t side = 0;
  bool ascending = false;  ///< the triangle runs along it from the lower vertex to the higher
};

/// All edges, grouped by lower vertex, then by higher vertex, then by triangle. Sides between equal
/// indices are left out; triangles with a repeated index altogether unless asked for.
class MeshEdges {
 public:
  explicit MeshEdges(const TriangleMesh& mesh, bool with_repeated_indices = false);

  /// Calls visit(low, uses, count) once for each edge.
  template <class Visit>
  void for_each(Visit&& visit) const {
    const std::size_t vertices = begin_.size() - 1;
    for (std::size_t low = 0; low < vertices; ++low) {
      for (std::size_t i = begin_[low]; i < begin_[low + 1];) {
        std::size_t j = i + 1;
        while (j < begin_[low + 1] && uses_[j].high == uses_[i].high) ++j;
        visit(static_cast<std::uint32_t>(low), &uses_[i], j - i);
        i = j;
      }
    }
  }

 private:
  std::vector<std::size_t> begin_;
  std::vector<EdgeUse> uses_;
};

inline bool has_repeated_index(const Triangle& t) {
  return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
}

/// For each vertex the first vertex with exactly the same coordinates (+0 and −0 are the same).
std::vector<std::uint32_t> first_equal_vertices(const std::vector<Vector3>& vertices);

/// Disjoint sets over 0..n-1; the smallest member is the root.
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0u); }
  std::uint32_t root(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    if (a == b) return;
    if (b < a) std::swap(a, b);
    parent_[b] = a;
  }

 private:
  std::vector<std::uint32_t> parent_;
};

/// Joins the corners (numbered 3·triangle + k) that meet across edges: one set for each fan of triangles
/// around a vertex. Corners of triangles with a repeated index stay alone.
DisjointSets corner_fans(const TriangleMesh& mesh, const MeshEdges& edges);

}  // namespace gnathion
