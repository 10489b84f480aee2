#include "design/adaptive_mesh.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh_query.h"
#include "design/extraction.h"

namespace gnathion {
namespace {

/// A ring with a flat top: curved and flat parts, genus 1.
double ring(const Vector3& p) {
  const double torus = std::hypot(std::hypot(p.x(), p.y()) - 4.0, p.z()) - 1.5;
  return std::max(torus, p.z() - 0.8);
}

TriangleMesh fine_ring() {
  GridShape shape;
  shape.spacing_mm = 0.3;
  shape.origin_mm = Vector3::Constant(-6.6);
  shape.nodes = Eigen::Vector3i::Constant(45);
  return extracted_surface({ring, pointwise(ring)}, shape, 3);
}

TEST(AdaptiveMesh, KeepsTopologyAndTolerance) {
  const TriangleMesh fine = fine_ring();
  AdaptiveMeshOptions options;
  options.tolerance_mm = [](const Vector3& p) { return p.x() > 0.0 ? 0.004 : 0.01; };
  const TriangleMesh mesh = adaptive_mesh(fine, options);
  EXPECT_LT(mesh.triangles.size() * 4, fine.triangles.size());
  const MeshTopology topology = mesh_topology(mesh);
  EXPECT_TRUE(topology.watertight());
  EXPECT_TRUE(topology.manifold());
  EXPECT_EQ(topology.components, 1u);
  EXPECT_EQ(topology.genus, 1);
  EXPECT_EQ(topology.degenerate_triangles, 0u);
  EXPECT_TRUE(self_intersections(mesh).empty());
  const MeshQuery query(mesh);
  const auto hits = closest_points(query, fine.vertices_mm);
  for (std::size_t v = 0; v < hits.size(); ++v)
    EXPECT_LE(std::abs(hits[v].distance_mm), options.tolerance_mm(fine.vertices_mm[v]) + 1e-9);
  // Vertices are those of the fine mesh; between them no triangle leaves the true surface by much more.
  const auto worst = [](const TriangleMesh& m) {
    double deviation = 0.0;
    for (std::size_t t = 0; t < m.triangles.size(); ++t)
      deviation =
          std::max(deviation, std::abs(ring((m.corner(t, 0) + m.corner(t, 1) + m.corner(t, 2)) / 3.0)));
    return deviation;
  };
  EXPECT_LT(worst(mesh), worst(fine) + 0.01);  // both cut the crease
  EXPECT_NEAR(signed_volume_mm3(mesh), signed_volume_mm3(fine), 0.002 * signed_volume_mm3(fine));
}

TEST(AdaptiveMesh, MakesNoSharperTrianglesThanAsked) {
  AdaptiveMeshOptions options;
  options.tolerance_mm = [](const Vector3&) { return 0.02; };
  options.sharpest_corner_deg = 20.0;
  const TriangleMesh fine = fine_ring();
  const TriangleMesh mesh = adaptive_mesh(fine, options);
  const auto sharpest = [](const TriangleMesh& m) {
    std::size_t n = 0;
    for (std::size_t t = 0; t < m.triangles.size(); ++t)
      for (int k = 0; k < 3; ++k) {
        const Vector3 a = m.corner(t, (k + 1) % 3) - m.corner(t, k),
                      b = m.corner(t, (k + 2) % 3) - m.corner(t, k);
        n += std::atan2(a.cross(b).norm(), a.dot(b)) < 20.0 * M_PI / 180.0 - 1e-9 ? 1 : 0;
      }
    return n;
  };
  EXPECT_LE(sharpest(mesh), sharpest(fine));
}

}  // namespace
}  // namespace gnathion
