#include <gtest/gtest.h>

#include <cmath>

#include "design/extraction.h"
#include "design/preparation.h"

namespace gnathion {
namespace {

/// A ball of 20 mm with what `cut` says removed.
template <class Cut>
TriangleMesh open_ball(const Cut& cut) {
  GridShape shape;
  shape.spacing_mm = 1.0;
  shape.origin_mm = Vector3::Constant(-12.0);
  shape.nodes = {25, 25, 25};
  const auto f = [](const Vector3& p) { return p.norm() - 10.0; };
  const TriangleMesh ball = extracted_surface({f, pointwise(f)}, shape, 2);
  std::vector<bool> keep(ball.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t)
    keep[t] = !cut((ball.corner(t, 0) + ball.corner(t, 1) + ball.corner(t, 2)) / 3.0);
  return submesh(ball, keep);
}

TEST(ClosedToSolid, FillsAScanHoleFlat) {
  const TriangleMesh open = open_ball([](const Vector3& p) { return (p - Vector3(0, 0, -10)).norm() < 1.5; });
  ASSERT_FALSE(mesh_topology(open).watertight());
  std::vector<std::string> filled;
  const TriangleMesh solid = closed_to_solid(open, Vector3::UnitZ(), &filled);
  const MeshTopology topology = mesh_topology(solid);
  EXPECT_TRUE(topology.watertight());
  EXPECT_EQ(topology.non_manifold_edges, 0u);
  EXPECT_EQ(filled.size(), 1u);
  const double ball = signed_volume_mm3(open_ball([](const Vector3&) { return false; }));
  EXPECT_NEAR(signed_volume_mm3(solid), ball, 1.0);  // a cap of 1.5 mm holds 0.4 mm³
}

TEST(ClosedToSolid, ExtrudesTheRimOfAScan) {
  const TriangleMesh scan = open_ball([](const Vector3& p) { return p.z() > 3.0; });
  const TriangleMesh solid = closed_to_solid(scan, Vector3::UnitZ(), nullptr);
  EXPECT_TRUE(mesh_topology(solid).watertight());
  EXPECT_EQ(mesh_topology(solid).non_manifold_edges, 0u);
  // Ball up to z = 3, then a cylinder of radius sqrt(91) to 2 mm above the scan's highest point.
  const double below = M_PI * (1000.0 * 2.0 / 3.0 + 100.0 * 3.0 - 9.0);
  const double prism = M_PI * 91.0 * 2.0;
  EXPECT_NEAR(signed_volume_mm3(solid), below + prism, 0.05 * (below + prism));
}

}  // namespace
}  // namespace gnathion
