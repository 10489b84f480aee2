#include "design/cube_table.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh_query.h"
#include "core/random.h"
#include "design/extraction.h"

namespace gnathion {
namespace {

TEST(CubeTable, OneInsideCornerIsCutOffByATriangleThatLooksOutwards) {
  ASSERT_EQ(cube_table()[1].triangles.size(), 1u);
  std::array<Vector3, 3> p;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto& edge = cube_edges()[cube_table()[1].triangles[0][i]];
    ASSERT_EQ(edge[0], 0);  // all three edges start at the corner
    p[i] = 0.5 * Vector3(edge[1] & 1, edge[1] >> 1 & 1, edge[1] >> 2 & 1);
  }
  EXPECT_GT((p[1] - p[0]).cross(p[2] - p[0]).dot(Vector3::Ones()), 0.0);
  EXPECT_TRUE(cube_table()[0].triangles.empty());
  EXPECT_TRUE(cube_table()[255].triangles.empty());
}

// Noise at every node meets all 256 cases and all pairs of ambiguous faces many times over.
TEST(CubeTable, NoiseGivesAClosedManifoldSurface) {
  GridShape shape;
  shape.spacing_mm = 1.0;
  shape.nodes = {14, 14, 14};
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    std::vector<double> values(shape.size());
    Random random(seed);
    for (double& v : values) v = random.uniform(-1.0, 1.0);
    ExtractionField field;
    field.estimate = [&](const Vector3& p) {
      const int i = static_cast<int>(std::lround(p.x())), j = static_cast<int>(std::lround(p.y())),
                k = static_cast<int>(std::lround(p.z()));
      const bool border = std::min({i, j, k}) == 0 || std::max({i, j, k}) == 13;
      return border ? 1.0 : values[shape.index(i, j, k)];
    };
    field.exact = pointwise(field.estimate);
    const TriangleMesh mesh = extracted_surface(field, shape, 1);
    const MeshTopology topology = mesh_topology(mesh);
    EXPECT_GT(topology.triangles, 3000u);
    EXPECT_TRUE(topology.watertight());
    EXPECT_EQ(topology.non_manifold_edges, 0u);
    EXPECT_EQ(topology.non_manifold_vertices, 0u);
    EXPECT_EQ(topology.degenerate_triangles, 0u);
    EXPECT_GT(signed_volume_mm3(mesh), 0.0);
  }
}

// Surfaces that the grid can represent do not cross themselves either.
TEST(CubeTable, WavesGiveNoSelfIntersections) {
  GridShape shape;
  shape.spacing_mm = 1.0;
  shape.nodes = {24, 24, 24};
  Random random(9);
  for (int round = 0; round < 3; ++round) {
    const Vector3 phase = 3.0 * random.normal3();
    ExtractionField field;
    field.estimate = [=](const Vector3& p) {
      const double box = (p - Vector3::Constant(11.5)).lpNorm<Eigen::Infinity>() - 10.0;
      const double waves = std::sin(1.1 * p.x() + phase.x()) * std::cos(0.9 * p.y()) +
                           std::sin(1.0 * p.y() + phase.y()) * std::cos(1.2 * p.z()) +
                           std::sin(0.8 * p.z() + phase.z()) * std::cos(1.0 * p.x());
      return std::max(box, waves);
    };
    field.exact = pointwise(field.estimate);
    const TriangleMesh mesh = extracted_surface(field, shape, 1);
    EXPECT_TRUE(mesh_topology(mesh).watertight() && mesh_topology(mesh).manifold());
    EXPECT_EQ(self_intersections(mesh, 10).size(), 0u);
  }
}

}  // namespace
}  // namespace gnathion
