#include "design/pressing.h"

#include <algorithm>

#include "design/parallel.h"
#include "design/solid_distance.h"

namespace gnathion {
namespace {

constexpr double kReachMm = 0.15;
constexpr double kVertexReachMm = 0.4;  // a crest's tip between the grid's nodes
constexpr int kRounds = 6;

struct Push {
  Vector3 by_mm = Vector3::Zero();
  void take(const Vector3& other) {
    if (other.squaredNorm() > by_mm.squaredNorm()) by_mm = other;
  }
};

/// The way out of the solid, or zero.
Vector3 way_out(const Vector3& p, const MeshQuery& solid, double tolerance_mm) {
  const auto d = solid_distance(solid, p, kReachMm);
  if (!d || d->distance_mm >= -tolerance_mm) return Vector3::Zero();
  return d->closest.point_mm - p;
}

/// Corners and centres of the listed triangles that are inside the solid.
void push_triangles(const TriangleMesh& mesh, const std::vector<std::uint32_t>& triangles,
                    const MeshQuery& solid, double tolerance_mm, std::vector<Push>& pushes) {
  std::vector<std::array<Vector3, 4>> ways(triangles.size());
  parallel_each(triangles.size(), [&](std::size_t i) {
    const std::uint32_t t = triangles[i];
    for (int k = 0; k < 3; ++k)
      ways[i][static_cast<std::size_t>(k)] = way_out(mesh.corner(t, k), solid, tolerance_mm);
    ways[i][3] =
        way_out((mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0, solid, tolerance_mm);
  });
  for (std::size_t i = 0; i < triangles.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      pushes[mesh.triangles[triangles[i]][k]].take(ways[i][k]);
      pushes[mesh.triangles[triangles[i]][k]].take(ways[i][3]);
    }
}

/// Vertices of the jaw inside the splint push the triangle that they pierced along their own normal. Returns
/// whether there were any.
bool push_by_jaw_vertices(const MeshQuery& splint, const MeshQuery& jaw, double tolerance_mm,
                          std::vector<Push>& pushes) {
  const auto& vertices = jaw.mesh().vertices_mm;
  const std::vector<Vector3> normals = vertex_normals(jaw.mesh());
  const Box box = bounding_box(splint.mesh());
  struct Hit {
    std::uint32_t triangle = 0;
    Vector3 by_mm = Vector3::Zero();
  };
  std::vector<Hit> hits(vertices.size());
  parallel_each(vertices.size(), [&](std::size_t v) {
    const Vector3& p = vertices[v];
    if ((p.array() < box.min_mm.array()).any() || (p.array() > box.max_mm.array()).any()) return;
    const auto d = splint.signed_distance(p, kVertexReachMm);
    if (d && d->distance_mm < -tolerance_mm) hits[v] = {d->closest.triangle, -d->distance_mm * normals[v]};
  });
  bool any = false;
  for (std::size_t v = 0; v < hits.size(); ++v) {
    if (hits[v].by_mm.isZero()) continue;
    any = true;
    for (const std::uint32_t corner : splint.mesh().triangles[hits[v].triangle])
      pushes[corner].take(hits[v].by_mm);
  }
  return any;
}

/// Takes moves back, by half at first, until the mesh does not cross itself.
void take_back_crossings(TriangleMesh& mesh, const std::vector<Vector3>& before) {
  for (int round = 0; round < 12; ++round) {
    const auto pairs = self_intersections(mesh);
    if (pairs.empty()) return;
    std::vector<std::uint32_t> corners;
    for (const auto& pair : pairs)
      for (const std::uint32_t t : pair)
        corners.insert(corners.end(), mesh.triangles[t].begin(), mesh.triangles[t].end());
    std::sort(corners.begin(), corners.end());
    corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
    const double kept = round < 3 ? 0.5 : 0.0;
    for (const std::uint32_t v : corners)
      mesh.vertices_mm[v] = before[v] + kept * (mesh.vertices_mm[v] - before[v]);
  }
  mesh.vertices_mm = before;
}

}  // namespace

std::size_t press_free_of_jaws(TriangleMesh& splint, const SplintField& field, double tolerance_mm) {
  const MeshQuery& maxilla = field.preparation().maxilla;
  const MeshQuery& mandible = field.preparation().mandible;
  const std::vector<Vector3> before = splint.vertices_mm;
  std::vector<char> near(splint.vertices_mm.size());
  parallel_each(near.size(), [&](std::size_t v) { near[v] = field.near_jaw(splint.vertices_mm[v], 0.0); });
  std::vector<std::uint32_t> todo;
  for (std::size_t t = 0; t < splint.triangles.size(); ++t) {
    const Triangle& c = splint.triangles[t];
    if (near[c[0]] || near[c[1]] || near[c[2]]) todo.push_back(static_cast<std::uint32_t>(t));
  }
  std::vector<char> moved(splint.vertices_mm.size(), 0);
  bool pierced = true;
  for (int round = 0; round < kRounds && (pierced || !todo.empty()); ++round) {
    std::vector<Push> pushes(splint.vertices_mm.size());
    for (const MeshQuery* jaw : {&maxilla, &mandible})
      push_triangles(splint, todo, *jaw, tolerance_mm, pushes);
    if (pierced) {
      const MeshQuery query(splint);
      pierced = false;
      for (const MeshQuery* jaw : {&maxilla, &mandible})
        pierced = push_by_jaw_vertices(query, *jaw, tolerance_mm, pushes) || pierced;
    }
    std::vector<char> now(pushes.size(), 0);
    for (std::size_t v = 0; v < pushes.size(); ++v)
      if (!pushes[v].by_mm.isZero()) {
        splint.vertices_mm[v] += pushes[v].by_mm;
        moved[v] = now[v] = 1;
      }
    todo.clear();
    for (std::size_t t = 0; t < splint.triangles.size(); ++t) {
      const Triangle& c = splint.triangles[t];
      if (now[c[0]] || now[c[1]] || now[c[2]]) todo.push_back(static_cast<std::uint32_t>(t));
    }
  }
  take_back_crossings(splint, before);
  return static_cast<std::size_t>(std::count(moved.begin(), moved.end(), 1));
}

}  // namespace gnathion
