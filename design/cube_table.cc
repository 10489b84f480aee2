#include "design/cube_table.h"

#include <algorithm>

#include "core/check.h"

namespace gnathion {
namespace {

using Edge = std::uint8_t;
using Loop = std::vector<Edge>;

struct Face {
  std::array<std::uint8_t, 4> corners;  // counter-clockwise seen from outside of the cube
  std::array<Edge, 4> edges;            // edges[i] joins corners[i] and corners[i + 1]
};

std::array<std::array<std::uint8_t, 2>, 12> make_edges() {
  std::array<std::array<std::uint8_t, 2>, 12> edges{};
  std::size_t n = 0;
  for (unsigned axis = 0; axis < 3; ++axis)
    for (unsigned c = 0; c < 8; ++c)
      if (!(c >> axis & 1U))
        edges[n++] = {static_cast<std::uint8_t>(c), static_cast<std::uint8_t>(c | 1U << axis)};
  return edges;
}

Edge edge_between(unsigned a, unsigned b) {
  const auto& edges = cube_edges();
  for (std::size_t e = 0; e < edges.size(); ++e)
    if (edges[e][0] == std::min(a, b) && edges[e][1] == std::max(a, b)) return static_cast<Edge>(e);
  GNATHION_CHECK(false);
}

std::array<Face, 6> make_faces() {
  std::array<Face, 6> faces{};
  std::size_t n = 0;
  for (unsigned axis = 0; axis < 3; ++axis)
    for (unsigned side = 0; side < 2; ++side) {
      const unsigned u = (axis + 1) % 3, v = (axis + 2) % 3;  // u × v = axis
      const unsigned base = side << axis;
      std::array<unsigned, 4> ring = {base, base | 1U << u, base | 1U << u | 1U << v, base | 1U << v};
      if (side == 0) std::reverse(ring.begin(), ring.end());
      Face& face = faces[n++];
      for (std::size_t i = 0; i < 4; ++i) {
        face.corners[i] = static_cast<std::uint8_t>(ring[i]);
        face.edges[i] = edge_between(ring[i], ring[(i + 1) % 4]);
      }
    }
  return faces;
}

bool share_a_face(const std::array<Face, 6>& faces, Edge a, Edge b) {
  return std::any_of(faces.begin(), faces.end(), [&](const Face& f) {
    return std::count(f.edges.begin(), f.edges.end(), a) && std::count(f.edges.begin(), f.edges.end(), b);
  });
}

/// Closed chains of crossed edges. On each face an inside run of corners is cut off by one segment.
std::vector<Loop> loops_of(const std::array<Face, 6>& faces, unsigned inside) {
  std::array<int, 12> next;
  next.fill(-1);
  for (const Face& face : faces)
    for (std::size_t i = 0; i < 4; ++i) {
      const bool here = inside >> face.corners[i] & 1U;
      const bool there = inside >> face.corners[(i + 1) % 4] & 1U;
      if (here || !there) continue;  // a run of inside corners begins after edges[i]
      std::size_t j = i + 1;
      while (inside >> face.corners[(j + 1) % 4] & 1U) ++j;
      next[face.edges[i]] = face.edges[j % 4];
    }
  std::vector<Loop> loops;
  std::array<bool, 12> seen{};
  for (Edge e = 0; e < 12; ++e) {
    if (next[e] < 0 || seen[e]) continue;
    Loop loop;
    for (Edge at = e; !seen[at]; at = static_cast<Edge>(next[at])) {
      seen[at] = true;
      loop.push_back(at);
    }
    loops.push_back(loop);
  }
  return loops;
}

/// Cuts ears whose diagonal does not lie in a face of the cube; false where that cannot be done.
bool triangulate(const std::array<Face, 6>& faces, const Loop& loop, std::vector<std::array<Edge, 3>>& out) {
  if (loop.size() == 3) {
    out.push_back({loop[0], loop[1], loop[2]});
    return true;
  }
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const Edge before = loop[(i + loop.size() - 1) % loop.size()], after = loop[(i + 1) % loop.size()];
    if (share_a_face(faces, before, after)) continue;
    Loop rest = loop;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
    const std::size_t mark = out.size();
    out.push_back({before, loop[i], after});
    if (triangulate(faces, rest, out)) return true;
    out.resize(mark);
  }
  return false;
}

std::array<CubeCase, 256> make_table() {
  const std::array<Face, 6> faces = make_faces();
  std::array<CubeCase, 256> table;
  for (unsigned inside = 0; inside < 256; ++inside)
    for (const Loop& loop : loops_of(faces, inside)) {
      const bool done = triangulate(faces, loop, table[inside].triangles);
      GNATHION_CHECK(done);  // holds for all 256 cases (cube_table_test)
    }
  return table;
}

}  // namespace

const std::array<std::array<std::uint8_t, 2>, 12>& cube_edges() {
  static const auto edges = make_edges();
  return edges;
}

const std::array<CubeCase, 256>& cube_table() {
  static const auto table = make_table();
  return table;
}

}  // namespace gnathion
