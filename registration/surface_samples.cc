#include "registration/surface_samples.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/random.h"
#include "registration/point_grid.h"

namespace gnathion {

std::vector<bool> triangles_of_mask(const TriangleMesh& mesh, const std::vector<bool>& vertex_mask) {
  std::vector<bool> keep(mesh.triangles.size(), true);
  if (vertex_mask.empty()) return keep;
  GNATHION_CHECK(vertex_mask.size() == mesh.vertices_mm.size());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& v = mesh.triangles[t];
    keep[t] = vertex_mask[v[0]] && vertex_mask[v[1]] && vertex_mask[v[2]];
  }
  return keep;
}

double kept_area_mm2(const TriangleMesh& mesh, const std::vector<bool>& keep) {
  double area = 0.0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (keep[t]) area += 0.5 * face_normal_scaled(mesh, t).norm();
  }
  return area;
}

SurfaceSamples sample_surface(const TriangleMesh& mesh, const std::vector<bool>& keep, std::size_t count,
                              std::uint64_t seed) {
  SurfaceSamples samples;
  const double area = kept_area_mm2(mesh, keep);
  if (!(area > 0.0) || count == 0) return samples;
  Random random(seed, 0x5a);
  const double step = area / static_cast<double>(count);
  double next = step * random.uniform(), passed = 0.0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!keep[t]) continue;
    const Vector3 scaled = face_normal_scaled(mesh, t);
    const double length = scaled.norm();
    if (!(length > 0.0)) continue;
    passed += 0.5 * length;
    while (next < passed) {
      // Uniform in the triangle (Osada 2002).
      const double r = std::sqrt(random.uniform()), s = random.uniform();
      samples.push_back(
          (1.0 - r) * mesh.corner(t, 0) + r * (1.0 - s) * mesh.corner(t, 1) + r * s * mesh.corner(t, 2),
          scaled / length, static_cast<std::uint32_t>(t));
      next += step;
    }
  }
  return samples;
}

SurfaceSamples sample_vertices(const TriangleMesh& mesh, const std::vector<bool>& keep, std::size_t count,
                               std::uint64_t seed) {
  const SurfaceSamples spread = sample_surface(mesh, keep, count, seed);
  std::vector<Vector3> normals(mesh.vertices_mm.size(), Vector3::Zero());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const std::uint32_t v : mesh.triangles[t]) normals[v] += face_normal_scaled(mesh, t);
  std::vector<bool> taken(mesh.vertices_mm.size(), false);
  SurfaceSamples samples;
  for (std::size_t i = 0; i < spread.size(); ++i) {
    const Triangle& corners = mesh.triangles[spread.triangles[i]];
    const std::uint32_t v =
        *std::min_element(corners.begin(), corners.end(), [&](std::uint32_t a, std::uint32_t b) {
          return (mesh.vertices_mm[a] - spread.points_mm[i]).squaredNorm() <
                 (mesh.vertices_mm[b] - spread.points_mm[i]).squaredNorm();
        });
    if (taken[v]) continue;
    taken[v] = true;
    samples.push_back(mesh.vertices_mm[v], normals[v].normalized(), spread.triangles[i]);
  }
  return samples;
}

SurfaceSamples thinned(const SurfaceSamples& dense, double spacing_mm, double normal_radius_mm) {
  const PointGrid grid(dense.points_mm, std::max(spacing_mm, normal_radius_mm));
  // Visited in a scrambled order, so that the subset does not follow the order of the triangles.
  std::vector<std::uint32_t> order(dense.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  Random random(dense.size(), 0x7b);
  for (std::size_t i = order.size(); i > 1; --i) {
    std::swap(order[i - 1], order[random.below(static_cast<std::uint32_t>(i))]);
  }
  std::vector<char> covered(dense.size(), 0);
  SurfaceSamples kept;
  for (const std::uint32_t i : order) {
    if (covered[i]) continue;
    const Vector3& normal = dense.normals[i];
    Vector3 mean = Vector3::Zero();
    grid.for_each_within(dense.points_mm[i], std::max(spacing_mm, normal_radius_mm),
                         [&](std::uint32_t k, double d2) {
                           const double cosine = dense.normals[k].dot(normal);
                           // The two faces of a thin plate keep a sample each.
                           if (cosine > 0.0 && d2 < spacing_mm * spacing_mm) covered[k] = 1;
                           if (cosine > 0.0 && d2 <= normal_radius_mm * normal_radius_mm) {
                             mean += dense.normals[k];
                           }
                         });
    const double length = mean.norm();
    kept.push_back(dense.points_mm[i], length > 0.0 ? Vector3(mean / length) : normal, dense.triangles[i]);
  }
  return kept;
}

}  // namespace gnathion
