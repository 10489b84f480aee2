#include "acquisition/scanner/depth_grid.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace gnathion {
namespace {

Vector3 ray_of(const DepthGrid& grid, int x, int y) {
  return {(x - grid.cx_px) / grid.fx_px, (y - grid.cy_px) / grid.fy_px, 1.0};
}

/// Whether two neighbouring pixels, `steps` apart, see one surface.
class Continuity {
 public:
  Continuity(const DepthGrid& grid, const GridMeshOptions& options)
      : grid_(grid),
        slope_(std::tan(options.max_incidence_deg * std::numbers::pi / 180) /
               std::min(grid.fx_px, grid.fy_px)),
        sigmas_(options.jump_sigmas) {}
  bool operator()(std::size_t a, std::size_t b, double steps) const {
    const double za = static_cast<double>(grid_.depth_mm[a]), zb = static_cast<double>(grid_.depth_mm[b]);
    const double noise =
        std::hypot(static_cast<double>(grid_.sigma_mm[a]), static_cast<double>(grid_.sigma_mm[b]));
    return std::abs(za - zb) <= std::max(slope_ * steps * std::min(za, zb), sigmas_ * noise);
  }

 private:
  const DepthGrid& grid_;
  double slope_, sigmas_;
};

/// The two triangles of each cell of four pixels, where they are continuous; the shorter diagonal in depth.
std::vector<Triangle> triangles_of(const DepthGrid& grid, const GridMeshOptions& options) {
  const Continuity near(grid, options);
  const double diagonal = std::sqrt(2.0);
  std::vector<Triangle> triangles;
  const auto add = [&](std::size_t a, std::size_t b, std::size_t c) {
    triangles.push_back(
        {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b), static_cast<std::uint32_t>(c)});
  };
  for (int y = 0; y + 1 < grid.height_px; ++y)
    for (int x = 0; x + 1 < grid.width_px; ++x) {
      // a b   Normals towards the camera: x right, y down, z away, so a c b.
      // c d
      const std::size_t a = grid.at(x, y), b = a + 1, c = grid.at(x, y + 1), d = c + 1;
      const auto seen = [&](std::size_t i) { return grid.depth_mm[i] > 0; };
      const auto whole = [&](std::size_t i, std::size_t j, std::size_t k, std::size_t far1,
                             std::size_t far2) {
        if (!seen(i) || !seen(j) || !seen(k)) return false;
        return near(i, j, 1) && near(i, k, 1) && near(far1, far2, diagonal);
      };
      const bool along_ad =
          std::abs(grid.depth_mm[a] - grid.depth_mm[d]) < std::abs(grid.depth_mm[b] - grid.depth_mm[c]);
      const bool ad = seen(a) && seen(d) && (along_ad || !seen(b) || !seen(c));
      if (ad) {
        if (whole(c, a, d, a, d)) add(a, c, d);
        if (whole(b, a, d, a, d)) add(a, d, b);
      } else {
        if (whole(a, b, c, b, c)) add(a, c, b);
        if (whole(d, b, c, b, c)) add(b, c, d);
      }
    }
  return triangles;
}

/// Drops small islands.
std::vector<bool> kept_triangles(const TriangleMesh& mesh, std::size_t smallest) {
  std::size_t count = 0;
  const std::vector<std::uint32_t> component = triangle_components(mesh, &count);
  std::vector<std::size_t> sizes(count, 0);
  for (const std::uint32_t c : component) ++sizes[c];
  std::vector<bool> keep(component.size());
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = sizes[component[t]] >= smallest;
  return keep;
}

}  // namespace

ScanSurface surface_from_grid(const DepthGrid& grid, const Rigid3& frame_from_camera,
                              const GridMeshOptions& options) {
  TriangleMesh mesh;
  mesh.vertices_mm.resize(grid.depth_mm.size());
  for (int y = 0; y < grid.height_px; ++y)
    for (int x = 0; x < grid.width_px; ++x)
      mesh.vertices_mm[grid.at(x, y)] =
          static_cast<double>(grid.depth_mm[grid.at(x, y)]) * ray_of(grid, x, y);
  mesh.triangles = triangles_of(grid, options);
  // What a vertex carries travels in a twin whose vertices are numbers, so that both are renumbered alike.
  TriangleMesh twin = mesh;
  for (std::size_t i = 0; i < twin.vertices_mm.size(); ++i)
    twin.vertices_mm[i] = {static_cast<double>(grid.sigma_mm[i]),
                           grid.grey.empty() ? 0.0 : static_cast<double>(grid.grey[i]), 0};
  const std::vector<bool> keep = kept_triangles(mesh, options.smallest_component);
  ScanSurface surface;
  surface.mesh = submesh(mesh, keep);
  twin = submesh(twin, keep);

  const std::vector<Vector3> normals = vertex_normals(surface.mesh);
  for (std::size_t v = 0; v < normals.size(); ++v) {
    Vector3& p = surface.mesh.vertices_mm[v];
    // A depth that is off by δz moves the point by δz·ray; what counts is its part along the normal.
    const Vector3 ray = p / p.z();
    surface.deviation_mm.push_back(twin.vertices_mm[v].x() * std::abs(normals[v].dot(ray)));
    p = frame_from_camera * p;
    if (grid.grey.empty()) continue;
    const auto grey = static_cast<std::uint8_t>(twin.vertices_mm[v].y());
    surface.mesh.colors_rgb.push_back({grey, grey, grey});
  }
  return surface;
}

}  // namespace gnathion
