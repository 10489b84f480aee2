#include "design/extraction.h"

#include <gtest/gtest.h>

#include <cmath>

namespace gnathion {
namespace {

GridShape box(double half_mm, double spacing_mm) {
  GridShape shape;
  shape.spacing_mm = spacing_mm;
  shape.origin_mm = Vector3::Constant(-half_mm);
  shape.nodes = Eigen::Vector3i::Constant(static_cast<int>(std::lround(2.0 * half_mm / spacing_mm)) + 1);
  return shape;
}

ExtractionField of(std::function<double(const Vector3&)> f) {
  return {f, pointwise(f)};
}

TEST(Extraction, SphereLiesOnTheSphere) {
  const double r = 5.0;
  const TriangleMesh mesh =
      extracted_surface(of([&](const Vector3& p) { return p.norm() - r; }), box(6.0, 0.3), 3);
  const MeshTopology topology = mesh_topology(mesh);
  EXPECT_TRUE(topology.watertight());
  EXPECT_TRUE(topology.manifold());
  EXPECT_EQ(topology.components, 1u);
  EXPECT_EQ(topology.genus, 0);
  double worst = 0.0;
  for (const Vector3& v : mesh.vertices_mm) worst = std::max(worst, std::abs(v.norm() - r));
  EXPECT_LT(worst, 0.1 * 0.02 + 0.01 / (8 * r));  // end margin of an edge, and linear interpolation
  const double volume = 4.0 / 3.0 * M_PI * r * r * r;
  EXPECT_NEAR(signed_volume_mm3(mesh), volume, 1e-3 * volume);
}

TEST(Extraction, FollowsTheSurfaceIntoCellsThatTheEstimateMissed) {
  // The estimate sees only half of the torus; the rest is found by following crossed faces.
  const auto torus = [](const Vector3& p) { return std::hypot(std::hypot(p.x(), p.y()) - 4.0, p.z()) - 1.0; };
  ExtractionField field;
  field.exact = pointwise(torus);
  field.estimate = [&](const Vector3& p) {
    return p.x() < -1e-9 && std::abs(torus(p)) > 0.25 ? 0.9 : torus(p);
  };
  const TriangleMesh mesh = extracted_surface(field, box(6.0, 0.4), 2);
  const MeshTopology topology = mesh_topology(mesh);
  EXPECT_TRUE(topology.watertight());
  EXPECT_TRUE(topology.manifold());
  EXPECT_EQ(topology.genus, 1);
}

TEST(Extraction, FinerVoxelsCostBySurfaceAndConverge) {
  const auto sphere = of([](const Vector3& p) { return p.norm() - 5.0; });
  const std::size_t coarse = extracted_surface(sphere, box(6.0, 0.4), 2).triangles.size();
  const std::size_t fine = extracted_surface(sphere, box(6.0, 0.4), 4).triangles.size();
  EXPECT_NEAR(static_cast<double>(fine) / static_cast<double>(coarse), 4.0, 0.2);
}

TEST(LargestPiece, DropsIslandsAndVoids) {
  const auto f = of([](const Vector3& p) {
    const double body = std::max(p.norm() - 4.0, 1.5 - (p - Vector3(0.5, 0, 0)).norm());
    return std::min(body, (p - Vector3(5, 5, 5)).norm() - 0.8);
  });
  const LargestPiece piece = largest_piece(extracted_surface(f, box(7.0, 0.4), 2));
  EXPECT_EQ(piece.dropped_voids, 1u);
  EXPECT_EQ(piece.dropped_islands, 1u);
  EXPECT_NEAR(piece.largest_island_mm3, 4.0 / 3.0 * M_PI * 0.512, 0.12);
  EXPECT_EQ(mesh_topology(piece.mesh).components, 1u);
  EXPECT_NEAR(signed_volume_mm3(piece.mesh), 4.0 / 3.0 * M_PI * 64.0, 1.0);
}

}  // namespace
}  // namespace gnathion
