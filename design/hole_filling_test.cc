#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

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

/// A dome like a cusp's, of that radius at its tip, 2 mm high or more, with a round hole on its side.
struct Cusp {
  double radius_mm, hole_mm, off_tip_mm;
};
class HolesOnCusps : public testing::TestWithParam<Cusp> {};

TEST_P(HolesOnCusps, AreFilledAsTheCuspGoesOnAndNothingProtrudes) {
  const auto [radius, hole, off_tip] = GetParam();
  // A hyperboloid of that curvature at its tip, on a grid of 0.12 mm.
  const double half = 2.4, step = 0.12;
  const auto height = [&, r = radius](double x, double y) {
    return r * (1.0 - std::hypot(1.0, std::hypot(x, y) / r));
  };
  TriangleMesh cusp;
  const int n = static_cast<int>(2.0 * half / step) + 1;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      const double x = -half + i * step, y = -half + j * step;
      cusp.vertices_mm.emplace_back(x, y, height(x, y));
    }
  const double off = off_tip, wide = hole;
  for (int i = 0; i + 1 < n; ++i)
    for (int j = 0; j + 1 < n; ++j) {
      const double x = -half + (i + 0.5) * step, y = -half + (j + 0.5) * step;
      if (std::hypot(x - off, y) < 0.5 * wide) continue;
      const auto v = [&](int a, int b) { return static_cast<std::uint32_t>((i + a) * n + j + b); };
      cusp.triangles.push_back({v(0, 0), v(1, 0), v(1, 1)});
      cusp.triangles.push_back({v(0, 0), v(1, 1), v(0, 1)});
    }
  std::vector<std::string> filled;
  const TriangleMesh solid = closed_to_solid(submesh(cusp, std::vector<bool>(cusp.triangles.size(), true)),
                                             -Vector3::UnitZ(), &filled, 5.0);
  ASSERT_TRUE(mesh_topology(solid).watertight());
  double low = 0.0, high = 0.0;  // the base lies deeper
  for (const Vector3& p : solid.vertices_mm)
    if (std::hypot(p.x() - off, p.y()) < 0.5 * wide && std::abs(p.z() - height(p.x(), p.y())) < 1.5) {
      low = std::min(low, p.z() - height(p.x(), p.y()));
      high = std::max(high, p.z() - height(p.x(), p.y()));
    }
  std::printf("hole of %.1f mm, tip of %.1f mm: %.3f .. %.3f mm\n", wide, radius, low, high);
  if (wide <= 1.0) {
    EXPECT_GT(low, -0.05);
    EXPECT_LT(high, 0.05);
  } else {
    EXPECT_GT(low, -0.005);  // what stands over the filling never stands in the tooth
    EXPECT_EQ(filled.size(), 1u);
  }
}

INSTANTIATE_TEST_SUITE_P(Tips, HolesOnCusps,
                         testing::Values(Cusp{1.0, 1.0, 0.0}, Cusp{1.5, 1.0, 0.4}, Cusp{3.0, 0.6, 0.0},
                                         Cusp{1.5, 3.0, 0.0}, Cusp{2.0, 3.0, 0.3}, Cusp{4.0, 2.0, 0.5},
                                         Cusp{-2.0, 1.0, 0.0}, Cusp{-3.0, 2.5, 0.2}));

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
