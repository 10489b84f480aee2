#include "design/crossings.h"

#include <algorithm>

#include "core/mesh_query.h"

namespace gnathion {

std::vector<std::uint32_t> triangles_at(const TriangleMesh& mesh, const std::vector<char>& marked) {
  std::vector<std::uint32_t> out;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& c = mesh.triangles[t];
    if (marked[c[0]] || marked[c[1]] || marked[c[2]]) out.push_back(static_cast<std::uint32_t>(t));
  }
  return out;
}

namespace {

/// Crossings of a mesh that had none before some of its vertices moved.
std::vector<std::array<std::uint32_t, 2>> crossings_by_moves(const TriangleMesh& mesh,
                                                             const std::vector<Vector3>& before) {
  std::vector<char> moved(before.size());
  for (std::size_t v = 0; v < moved.size(); ++v) moved[v] = mesh.vertices_mm[v] != before[v] ? 1 : 0;
  const std::vector<std::uint32_t> triangles = triangles_at(mesh, moved);
  if (triangles.empty()) return {};
  std::vector<std::uint32_t> names;
  const TriangleMesh part = Surroundings(mesh, triangles, 0.0).part_of(mesh, names);
  auto pairs = self_intersections(part);
  for (auto& pair : pairs)
    for (std::uint32_t& t : pair) t = names[t];
  return pairs;
}

}  // namespace

bool take_back_crossings(TriangleMesh& mesh, const std::vector<Vector3>& before) {
  for (int round = 0; round < 12; ++round) {
    const auto pairs = crossings_by_moves(mesh, before);
    if (pairs.empty()) return round > 0;
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
  return true;
}

}  // namespace gnathion
