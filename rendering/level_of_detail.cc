#include "rendering/level_of_detail.h"

#include <cmath>
#include <numeric>
#include <unordered_map>

namespace gnathion {

CoarseMesh clustered(const TriangleMesh& mesh, std::size_t triangles) {
  CoarseMesh out;
  if (mesh.triangles.size() <= triangles) {
    out.mesh.vertices_mm = mesh.vertices_mm;
    out.mesh.triangles = mesh.triangles;
    out.source.resize(mesh.vertices_mm.size());
    std::iota(out.source.begin(), out.source.end(), 0u);
    return out;
  }
  // A surface of area A has about 2.7·A/c² triangles when its vertices are clustered in cells of c.
  const double cell_mm = std::sqrt(2.7 * surface_area_mm2(mesh) / static_cast<double>(triangles));
  const Vector3 low = bounding_box(mesh).min_mm;
  struct Cell {
    std::uint32_t index = 0, count = 0;
    Vector3 sum = Vector3::Zero();
  };
  std::unordered_map<std::uint64_t, Cell> cells;
  std::vector<std::uint32_t> cell_of(mesh.vertices_mm.size());
  std::vector<std::uint64_t> keys;
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    const Vector3 k = ((mesh.vertices_mm[i] - low) / cell_mm).array().floor();
    const std::uint64_t key = static_cast<std::uint64_t>(k.x()) << 42 |
                              static_cast<std::uint64_t>(k.y()) << 21 | static_cast<std::uint64_t>(k.z());
    const auto [at, fresh] = cells.try_emplace(key);
    if (fresh) {
      at->second.index = static_cast<std::uint32_t>(keys.size());
      keys.push_back(key);
    }
    at->second.sum += mesh.vertices_mm[i];
    ++at->second.count;
    cell_of[i] = at->second.index;
  }
  out.mesh.vertices_mm.resize(keys.size());
  for (const auto& [key, cell] : cells) out.mesh.vertices_mm[cell.index] = cell.sum / cell.count;
  std::vector<double> best(keys.size(), 1e300);
  out.source.resize(keys.size());
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    const std::uint32_t c = cell_of[i];
    const double d = (mesh.vertices_mm[i] - out.mesh.vertices_mm[c]).squaredNorm();
    if (d < best[c]) best[c] = d, out.source[c] = static_cast<std::uint32_t>(i);
  }
  for (const Triangle& t : mesh.triangles) {
    const Triangle small = {cell_of[t[0]], cell_of[t[1]], cell_of[t[2]]};
    if (small[0] != small[1] && small[1] != small[2] && small[0] != small[2])
      out.mesh.triangles.push_back(small);
  }
  return out;
}

}  // namespace gnathion
