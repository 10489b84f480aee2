#include "phantom/jaws_bite.h"

#include <algorithm>
#include <numeric>

#include <tbb/parallel_for.h>

#include "core/mesh_query.h"

namespace gnathion {
namespace {

constexpr double kFarMm = 1.0;

/// Distance of each vertex of `mesh` from the other jaw, kFarMm where it is farther.
std::vector<double> gaps(const TriangleMesh& mesh, const MeshQuery& other) {
  std::vector<double> gap(mesh.vertices_mm.size(), kFarMm);
  const Box box = bounding_box(other.mesh());
  tbb::parallel_for(std::size_t{0}, gap.size(), [&](std::size_t i) {
    const Vector3& p = mesh.vertices_mm[i];
    if (p.z() < box.min_mm.z() - kFarMm || p.z() > box.max_mm.z() + kFarMm) return;
    const auto found = other.signed_distance(p, kFarMm);
    if (found && !found->closest.on_boundary) gap[i] = found->distance_mm;
  });
  return gap;
}

std::uint32_t root(std::vector<std::uint32_t>& parent, std::uint32_t i) {
  while (parent[i] != i) i = parent[i] = parent[parent[i]];
  return i;
}

}  // namespace

PhantomBite measure_bite(const PhantomJaws& jaws) {
  PhantomBite bite;
  const MeshQuery upper(jaws.maxilla), lower(jaws.mandible_mi);
  const std::vector<double> gap = gaps(jaws.mandible_mi, upper);
  for (const double g : gap) bite.overlap_mm = std::max(bite.overlap_mm, -g);
  for (const double g : gaps(jaws.maxilla, lower)) bite.overlap_mm = std::max(bite.overlap_mm, -g);

  std::vector<std::uint32_t> parent(gap.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto touches = [&](std::uint32_t v) {
    return gap[v] <= kContactGapMm && jaws.mandible_fdi[v] % 10 >= 3;
  };
  for (const Triangle& t : jaws.mandible_mi.triangles) {
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      if (touches(a) && touches(b)) parent[root(parent, a)] = root(parent, b);
    }
  }
  std::vector<int> index(gap.size(), -1);
  for (std::uint32_t v = 0; v < gap.size(); ++v) {
    if (!touches(v)) continue;
    int& i = index[root(parent, v)];
    if (i < 0) {
      i = static_cast<int>(bite.contacts.size());
      bite.contacts.push_back({jaws.mandible_fdi[v], jaws.mandible_mi.vertices_mm[v], gap[v], 0.0});
    }
    BiteContact& c = bite.contacts[i];
    if (gap[v] < c.gap_mm) c = {jaws.mandible_fdi[v], jaws.mandible_mi.vertices_mm[v], gap[v], c.area_mm2};
  }
  for (std::size_t t = 0; t < jaws.mandible_mi.triangles.size(); ++t) {
    const Triangle& tri = jaws.mandible_mi.triangles[t];
    for (int k = 0; k < 3; ++k) {
      if (!touches(tri[k])) continue;
      bite.contacts[index[root(parent, tri[k])]].area_mm2 +=
          face_normal_scaled(jaws.mandible_mi, t).norm() / 6.0;
    }
  }
  for (const BiteContact& c : bite.contacts) ++(c.point_mm.x() > 0 ? bite.left : bite.right);
  return bite;
}

void grind_in(PhantomJaws& jaws) {
  constexpr double kToleratedMm = 0.006;
  const MeshQuery upper(jaws.maxilla);
  auto& vertices = jaws.mandible_mi.vertices_mm;
  for (int round = 0; round < 4; ++round) {
    // Lower vertices inside the upper jaw go to its surface.
    bool changed = false;
    const std::vector<double> gap = gaps(jaws.mandible_mi, upper);
    for (std::size_t i = 0; i < vertices.size(); ++i) {
      if (gap[i] > -kToleratedMm) continue;
      const auto at = upper.closest(vertices[i], kFarMm);
      vertices[i] = at->point_mm;
      changed = true;
    }
    // Where an upper vertex reaches through a lower triangle, the triangle's corners give way.
    const MeshQuery lower(jaws.mandible_mi);
    const std::vector<double> above = gaps(jaws.maxilla, lower);
    for (std::size_t i = 0; i < above.size(); ++i) {
      if (above[i] > -kToleratedMm) continue;
      const auto at = lower.closest(jaws.maxilla.vertices_mm[i], kFarMm);
      const Triangle& t = jaws.mandible_mi.triangles[at->triangle];
      const Vector3 n = face_normal_scaled(jaws.mandible_mi, at->triangle).normalized();
      const Vector3& b = at->barycentric;
      const double share = std::max(b.squaredNorm(), 0.3);
      for (int k = 0; k < 3; ++k) vertices[t[k]] += above[i] * b[k] / share * n;
      changed = true;
    }
    if (!changed) return;
  }
}

}  // namespace gnathion
