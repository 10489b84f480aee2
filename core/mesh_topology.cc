// How a mesh's triangles meet: components, boundary, manifoldness, genus.
#include <algorithm>
#include <unordered_map>

#include "core/mesh_edges.h"

namespace gnathion {
namespace {

constexpr std::uint32_t kNone = 0xffffffffu;

/// Corner of the use's triangle at the edge's lower (or higher) vertex.
std::uint32_t corner_at(const EdgeUse& use, bool at_low) {
  const bool at_start = use.ascending == at_low;
  return 3 * use.triangle + (at_start ? use.side : (use.side + 1u) % 3u);
}

bool zero_area(const TriangleMesh& mesh, std::size_t triangle) {
  return face_normal_scaled(mesh, triangle).squaredNorm() == 0.0;
}

/// Euler characteristic of one component with its pinched vertices taken apart.
struct Surface {
  long faces = 0, edges = 0, fans = 0;
  bool closed_manifold = true;
};

/// A rim that comes through a vertex twice is two loops that touch there.
void split_at_repeated_vertices(const std::vector<std::uint32_t>& rim,
                                std::vector<std::vector<std::uint32_t>>& loops) {
  std::vector<std::uint32_t> open;
  std::unordered_map<std::uint32_t, std::size_t> place;
  for (const std::uint32_t vertex : rim) {
    const auto [before, fresh] = place.try_emplace(vertex, open.size());
    if (!fresh) {
      const auto from = open.begin() + static_cast<std::ptrdiff_t>(before->second);
      loops.emplace_back(from, open.end());
      for (auto it = from + 1; it != open.end(); ++it) place.erase(*it);
      open.erase(from + 1, open.end());
    } else {
      open.push_back(vertex);
    }
  }
  loops.push_back(std::move(open));
}

}  // namespace

MeshEdges::MeshEdges(const TriangleMesh& mesh, bool with_repeated_indices)
    : begin_(mesh.vertices_mm.size() + 1, 0) {
  const auto for_each_side = [&](auto&& visit) {
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      const Triangle& t = mesh.triangles[i];
      if (!with_repeated_indices && has_repeated_index(t)) continue;
      for (std::uint8_t k = 0; k < 3; ++k) {
        const std::uint32_t a = t[k], b = t[(k + 1u) % 3u];
        if (a != b) visit(i, k, a, b);
      }
    }
  };
  // Counting sort by the lower vertex, then each small bucket by the higher one.
  for_each_side(
      [&](std::size_t, std::uint8_t, std::uint32_t a, std::uint32_t b) { ++begin_[std::min(a, b) + 1u]; });
  for (std::size_t v = 1; v < begin_.size(); ++v) begin_[v] += begin_[v - 1];
  uses_.resize(begin_.back());
  std::vector<std::size_t> next(begin_.begin(), begin_.end() - 1);
  for_each_side([&](std::size_t i, std::uint8_t k, std::uint32_t a, std::uint32_t b) {
    uses_[next[std::min(a, b)]++] = {std::max(a, b), static_cast<std::uint32_t>(i), k, a < b};
  });
  for (std::size_t v = 0; v + 1 < begin_.size(); ++v) {
    std::sort(uses_.begin() + static_cast<std::ptrdiff_t>(begin_[v]),
              uses_.begin() + static_cast<std::ptrdiff_t>(begin_[v + 1]),
              [](const EdgeUse& p, const EdgeUse& q) {
                if (p.high != q.high) return p.high < q.high;
                return p.triangle != q.triangle ? p.triangle < q.triangle : p.side < q.side;
              });
  }
}

DisjointSets corner_fans(const TriangleMesh& mesh, const MeshEdges& edges) {
  DisjointSets fans(3 * mesh.triangles.size());
  edges.for_each([&](std::uint32_t, const EdgeUse* uses, std::size_t count) {
    for (std::size_t i = 1; i < count; ++i) {
      fans.join(corner_at(uses[0], true), corner_at(uses[i], true));
      fans.join(corner_at(uses[0], false), corner_at(uses[i], false));
    }
  });
  return fans;
}

std::vector<std::uint32_t> triangle_components(const TriangleMesh& mesh, std::size_t* count) {
  DisjointSets sets(mesh.triangles.size());
  MeshEdges(mesh, true).for_each([&](std::uint32_t, const EdgeUse* uses, std::size_t n) {
    for (std::size_t i = 1; i < n; ++i) sets.join(uses[0].triangle, uses[i].triangle);
  });
  std::vector<std::uint32_t> component(mesh.triangles.size());
  std::uint32_t next = 0;
  for (std::uint32_t i = 0; i < component.size(); ++i) {
    const std::uint32_t root = sets.root(i);  // never greater than i
    component[i] = root == i ? next++ : component[root];
  }
  if (count != nullptr) *count = next;
  return component;
}

MeshTopology mesh_topology(const TriangleMesh& mesh) {
  MeshTopology facts;
  facts.vertices = mesh.vertices_mm.size();
  facts.triangles = mesh.triangles.size();
  const MeshEdges edges(mesh);
  const std::vector<std::uint32_t> component = triangle_components(mesh, &facts.components);
  std::vector<Surface> surfaces(facts.components);

  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const bool repeated = has_repeated_index(mesh.triangles[i]);
    if (repeated || zero_area(mesh, i)) ++facts.degenerate_triangles;
    if (!repeated) ++surfaces[component[i]].faces;
  }
  edges.for_each([&](std::uint32_t, const EdgeUse* uses, std::size_t n) {
    Surface& surface = surfaces[component[uses[0].triangle]];
    ++surface.edges;
    if (n == 2 && uses[0].ascending != uses[1].ascending) return;
    surface.closed_manifold = false;
    ++(n == 1 ? facts.boundary_edges : facts.non_manifold_edges);
  });

  // One root for each fan; a vertex of several fans is where surfaces touch in a point.
  DisjointSets fans = corner_fans(mesh, edges);
  std::vector<std::uint8_t> fans_at(mesh.vertices_mm.size(), 0);
  for (std::uint32_t corner = 0; corner < 3 * mesh.triangles.size(); ++corner) {
    const Triangle& t = mesh.triangles[corner / 3];
    if (has_repeated_index(t) || fans.root(corner) != corner) continue;
    ++surfaces[component[corner / 3]].fans;
    std::uint8_t& n = fans_at[t[corner % 3]];
    if (n == 1) ++facts.non_manifold_vertices;
    if (n < 2) ++n;
  }
  // χ = V − E + F = 2 − 2g holds for closed manifold components alone; others add nothing.
  for (const Surface& s : surfaces) {
    if (s.faces == 0) --facts.components;  // nothing but collapsed triangles
    if (s.faces > 0 && s.closed_manifold) facts.genus += (2 - (s.fans - s.edges + s.faces)) / 2;
  }
  return facts;
}

std::vector<std::vector<std::uint32_t>> boundary_loops(const TriangleMesh& mesh) {
  // Boundary sides, in triangle order and direction, are followed from fan to fan (not from vertex to
  // vertex), so that the rims of two surfaces that touch in one vertex stay apart.
  const MeshEdges edges(mesh);
  DisjointSets fans = corner_fans(mesh, edges);
  struct Side {
    std::uint32_t from, to, from_fan, to_fan;
  };
  std::vector<Side> sides;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> order;  // triangle·3 + side, index
  edges.for_each([&](std::uint32_t, const EdgeUse* uses, std::size_t n) {
    if (n != 1) return;
    const std::uint32_t a = 3 * uses->triangle + uses->side;
    const std::uint32_t b = 3 * uses->triangle + (uses->side + 1u) % 3u;
    order.emplace_back(a, static_cast<std::uint32_t>(sides.size()));
    sides.push_back({mesh.triangles[a / 3][a % 3], mesh.triangles[b / 3][b % 3], fans.root(a), fans.root(b)});
  });
  std::sort(order.begin(), order.end());

  // Sides at each fan, by a sorted list of (fan, leaves the fan first, side).
  std::vector<std::array<std::uint32_t, 3>> at_fan;
  for (std::uint32_t i = 0; i < sides.size(); ++i) {
    at_fan.push_back({sides[i].from_fan, 0, i});
    at_fan.push_back({sides[i].to_fan, 1, i});
  }
  std::sort(at_fan.begin(), at_fan.end());
  std::vector<bool> used(sides.size(), false);
  const auto next_side = [&](std::uint32_t fan) {
    auto it = std::lower_bound(at_fan.begin(), at_fan.end(), std::array<std::uint32_t, 3>{fan, 0, 0});
    while (it != at_fan.end() && (*it)[0] == fan && used[(*it)[2]]) ++it;
    return it != at_fan.end() && (*it)[0] == fan ? (*it)[2] : kNone;
  };

  std::vector<std::vector<std::uint32_t>> loops;
  for (const auto& [corner, start] : order) {
    if (used[start]) continue;
    std::vector<std::uint32_t> loop;
    std::uint32_t side = start, fan = sides[start].from_fan;
    while (side != kNone) {
      used[side] = true;
      const bool forward = sides[side].from_fan == fan;
      loop.push_back(forward ? sides[side].from : sides[side].to);
      fan = forward ? sides[side].to_fan : sides[side].from_fan;
      if (fan == sides[start].from_fan) break;
      side = next_side(fan);
    }
    // At a non-manifold edge a chain may run out of sides: it closes no hole and is left out.
    if (side != kNone) split_at_repeated_vertices(loop, loops);
  }
  return loops;
}

}  // namespace gnathion
