// Depths on straight ways, against solids whose answer is known in closed form.
#include "design/swept_depth.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/random.h"

namespace gnathion {
namespace {

/// Sphere of radius 3 about the origin, facets within 0.003 mm of it.
TriangleMesh ball() {
  TriangleMesh mesh;
  constexpr int kRows = 90, kColumns = 180;
  for (int i = 0; i <= kRows; ++i)
    for (int j = 0; j < kColumns; ++j) {
      const double u = M_PI * i / kRows, v = 2.0 * M_PI * j / kColumns;
      mesh.vertices_mm.emplace_back(3.0 * std::sin(u) * std::cos(v), 3.0 * std::sin(u) * std::sin(v),
                                    3.0 * std::cos(u));
    }
  const auto id = [](int i, int j) { return static_cast<std::uint32_t>(i * kColumns + j % kColumns); };
  for (int i = 0; i < kRows; ++i)
    for (int j = 0; j < kColumns; ++j) {
      if (i > 0) mesh.triangles.push_back({id(i, j), id(i + 1, j), id(i, j + 1)});
      if (i + 1 < kRows) mesh.triangles.push_back({id(i, j + 1), id(i + 1, j), id(i + 1, j + 1)});
    }
  return mesh;
}

TEST(SweptDepth, IsTheChordsDepthInABall) {
  const MeshQuery solid(ball());
  Random random(3);
  for (int n = 0; n < 50; ++n) {
    const Vector3 direction = random.rotation().col(0);
    const Vector3 across = direction.unitOrthogonal();
    const double miss = 0.06 * n + 0.05;  // how far the way passes the centre
    const auto depth = deepest_on_way({miss * across - 6.0 * direction}, direction, 12.0, solid);
    EXPECT_NEAR(depth.depth_mm, std::max(0.0, 3.0 - miss), 0.008) << miss;
    if (miss < 2.9) {
      EXPECT_NEAR(depth.way_mm, 6.0, 0.3);
    }
  }
}

TEST(SweptDepth, KnowsNothingOfWhatLiesBehindOrBeyondTheWay) {
  const MeshQuery solid(ball());
  const Vector3 z = Vector3::UnitZ();
  EXPECT_EQ(deepest_on_way({Vector3(0, 0, 3.5)}, z, 12.0, solid).depth_mm, 0.0);
  EXPECT_EQ(deepest_on_way({Vector3(0, 0, -9.5)}, z, 6.0, solid).depth_mm, 0.0);
  EXPECT_EQ(deepest_on_way({Vector3(3.2, 0, -6.0)}, z, 12.0, solid).depth_mm, 0.0);
  // One that begins inside.
  EXPECT_NEAR(deepest_on_way({Vector3(0, 0, 1.0)}, z, 12.0, solid).depth_mm, 2.0, 0.02);
}

TEST(SweptDepth, TellsTheDeepestPoint) {
  const MeshQuery solid(ball());
  const std::vector<Vector3> points = {{2.9, 0, -5}, {0, 2.0, -5}, {2.5, 0, -5}};
  const auto depth = deepest_on_way(points, Vector3::UnitZ(), 12.0, solid);
  EXPECT_EQ(depth.start_mm, points[1]);
  EXPECT_NEAR(depth.depth_mm, 1.0, 0.008);
}

}  // namespace
}  // namespace gnathion
