#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include <fmt/format.h>

#include "design/hole_patch.h"
#include "design/preparation.h"

namespace gnathion {
namespace {

constexpr std::size_t kLargestExactLoop = 80;

using Loop = std::vector<std::uint32_t>;

/// Turns each loop so that a triangle (v0, v1, new) fits the neighbouring triangles' winding.
void orient_against_triangles(const TriangleMesh& mesh, std::vector<Loop>& loops) {
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (const Loop& loop : loops)
    for (std::size_t i = 0; i < loop.size(); ++i) {
      edges.insert({loop[i], loop[(i + 1) % loop.size()]});
      edges.insert({loop[(i + 1) % loop.size()], loop[i]});
    }
  std::set<std::pair<std::uint32_t, std::uint32_t>> used;  // directed, as triangles run
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::pair<std::uint32_t, std::uint32_t> edge{t[k], t[(k + 1) % 3]};
      if (edges.count(edge)) used.insert(edge);
    }
  for (Loop& loop : loops)
    if (used.count({loop[0], loop[1]})) std::reverse(loop.begin(), loop.end());
}

/// Triangulation of least area (Barequet & Sharir 1995); O(n³).
void fill_with_least_area(const std::vector<Vector3>& p, const Loop& loop, std::vector<Triangle>& out) {
  const std::size_t n = loop.size();
  std::vector<double> cost(n * n, 0.0);
  std::vector<std::size_t> split(n * n, 0);
  for (std::size_t length = 2; length < n; ++length)
    for (std::size_t i = 0; i + length < n; ++i) {
      const std::size_t j = i + length;
      double best = std::numeric_limits<double>::infinity();
      for (std::size_t m = i + 1; m < j; ++m) {
        const double area = 0.5 * (p[loop[m]] - p[loop[i]]).cross(p[loop[j]] - p[loop[i]]).norm() +
                            cost[i * n + m] + cost[m * n + j];
        if (area < best) {
          best = area;
          split[i * n + j] = m;
        }
      }
      cost[i * n + j] = best;
    }
  std::vector<std::pair<std::size_t, std::size_t>> stack{{0, n - 1}};
  while (!stack.empty()) {
    const auto [i, j] = stack.back();
    stack.pop_back();
    if (j < i + 2) continue;
    const std::size_t m = split[i * n + j];
    out.push_back({loop[i], loop[m], loop[j]});
    stack.push_back({i, m});
    stack.push_back({m, j});
  }
}

void fill_with_fan(TriangleMesh& mesh, const Loop& loop) {
  Vector3 centre = Vector3::Zero();
  for (const std::uint32_t v : loop) centre += mesh.vertices_mm[v];
  const auto hub = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  mesh.vertices_mm.push_back(centre / static_cast<double>(loop.size()));
  for (std::size_t i = 0; i < loop.size(); ++i)
    mesh.triangles.push_back({loop[i], loop[(i + 1) % loop.size()], hub});
}

/// A wall from the rim to a plane beyond the whole mesh, and a flat cap.
void close_rim(TriangleMesh& mesh, const Loop& loop, const Vector3& away) {
  double plane = -1e300;
  for (const Vector3& v : mesh.vertices_mm) plane = std::max(plane, away.dot(v));
  plane += 2.0;
  const auto first = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  const std::size_t n = loop.size();
  Loop cap(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Vector3 v = mesh.vertices_mm[loop[i]];
    cap[i] = first + static_cast<std::uint32_t>(i);
    mesh.vertices_mm.push_back(v + (plane - away.dot(v)) * away);
  }
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t j = (i + 1) % n;
    mesh.triangles.push_back({loop[i], loop[j], cap[j]});
    mesh.triangles.push_back({loop[i], cap[j], cap[i]});
  }
  fill_with_fan(mesh, cap);
}

}  // namespace

TriangleMesh closed_to_solid(const TriangleMesh& mesh, const Vector3& away, std::vector<std::string>* filled,
                             double rim_width_mm) {
  TriangleMesh solid;
  solid.vertices_mm = mesh.vertices_mm;
  solid.triangles = mesh.triangles;
  std::vector<Loop> loops = boundary_loops(mesh);
  loops.erase(std::remove_if(loops.begin(), loops.end(), [](const Loop& l) { return l.size() < 3; }),
              loops.end());
  orient_against_triangles(mesh, loops);
  const std::vector<Vector3> normals = loops.empty() ? std::vector<Vector3>() : vertex_normals(mesh);
  for (const Loop& loop : loops) {
    Box box;
    for (const std::uint32_t v : loop) box.extend(solid.vertices_mm[v]);
    const double width_mm = box.size_mm().norm();
    if (width_mm > rim_width_mm) {
      close_rim(solid, loop, away);
      continue;
    }
    const bool restored = fill_with_patch(solid, normals, loop);
    if (!restored) {
      if (loop.size() <= kLargestExactLoop)
        fill_with_least_area(solid.vertices_mm, loop, solid.triangles);
      else
        fill_with_fan(solid, loop);
    }
    if (width_mm > 1.0 && filled)
      filled->push_back(fmt::format(
          "hole of {:.1f} mm filled at ({:.1f}, {:.1f}, {:.1f}){}", width_mm, box.centre_mm().x(),
          box.centre_mm().y(), box.centre_mm().z(),
          restored || width_mm <= kUnsureHoleMm
              ? ""
              : ": the surface there was not restored, what is built against it may be off: scan it again"));
  }
  return solid;
}

}  // namespace gnathion
