#include "design/coarse_grid.h"

#include <gtest/gtest.h>

#include <cmath>

namespace gnathion {
namespace {

GridShape cube() {
  GridShape shape;
  shape.spacing_mm = 0.3;
  shape.origin_mm = Vector3::Constant(-6.0);
  shape.nodes = {41, 41, 41};
  return shape;
}

template <class F>
CoarseGrid sampled(const GridShape& shape, const F& f) {
  CoarseGrid grid(shape, 0.0f);
  for (int i = 0; i < shape.nodes.x(); ++i)
    for (int j = 0; j < shape.nodes.y(); ++j)
      for (int k = 0; k < shape.nodes.z(); ++k)
        grid.at(i, j, k) = static_cast<float>(f(shape.position(i, j, k)));
  return grid;
}

/// Calls check(p) at points that are no nodes, over |x|, |y|, |z| < reach.
template <class Check>
void at_points(double reach, const Check& check) {
  for (double x = -reach; x <= reach; x += 0.73)
    for (double y = -reach; y <= reach; y += 0.73)
      for (double z = -reach; z <= reach; z += 0.73) check(Vector3(x, y, z));
}

TEST(CoarseGrid, LinearReproducesLinearFunctions) {
  const auto f = [](const Vector3& p) { return 1.0 + 2 * p.x() - 3 * p.y() + 0.5 * p.z(); };
  const CoarseGrid grid = sampled(cube(), f);
  at_points(5.0, [&](const Vector3& p) {
    EXPECT_NEAR(grid.linear(p), f(p), 1e-4);
    EXPECT_NEAR(grid.smooth(p), f(p), 1e-4);
  });
}

TEST(CoarseGrid, SweptBallIsACapsule) {
  const CoarseGrid ball = sampled(cube(), [](const Vector3& p) { return p.norm() - 2.0; });
  const CoarseGrid up = swept_up(ball);
  const CoarseGrid down = swept_down(ball);
  at_points(4.5, [&](const Vector3& p) {
    const double wall = std::hypot(p.x(), p.y()) - 2.0;
    if (wall < -1.2) return;  // near the axis: no distance there
    EXPECT_NEAR(up.linear(p), p.z() > 0 ? wall : p.norm() - 2.0, 0.03) << p.transpose();
    EXPECT_NEAR(down.linear(p), p.z() < 0 ? wall : p.norm() - 2.0, 0.03) << p.transpose();
  });
}

TEST(CoarseGrid, DraftNarrowsTheSweep) {
  const CoarseGrid up = swept_up(sampled(cube(), [](const Vector3& p) { return p.norm() - 3.0; }), 0.6);
  // sin δ = 0.6: the ball of radius 3 goes over into a cone with walls at δ to the axis, 0.8 ρ + 0.6 z = 3.
  for (const double rho : {0.5, 1.0, 1.5, 2.0})
    EXPECT_NEAR(up.linear({rho, 0.0, (3.0 - 0.8 * rho) / 0.6}), 0.0, 0.06) << rho;
  EXPECT_NEAR(up.linear({0.0, 2.0, -3.0}), std::sqrt(13.0) - 3.0, 0.03);
}

TEST(CoarseGrid, RedistancedIsADistance) {
  const CoarseGrid squashed = sampled(cube(), [](const Vector3& p) { return 0.2 * (p.squaredNorm() - 9.0); });
  const CoarseGrid d = redistanced(squashed, 4.0);
  at_points(4.0, [&](const Vector3& p) {
    if (p.norm() < 1.0 || p.norm() > 5.5) return;
    EXPECT_NEAR(d.linear(p), p.norm() - 3.0, 0.12) << p.transpose();
  });
}

TEST(CoarseGrid, ClosingFillsTheGrooveAndLeavesTheRest) {
  // Two balls that overlap: the waist gets a fillet, the far sides stay.
  const CoarseGrid balls = sampled(cube(), [](const Vector3& p) {
    return std::min((p - Vector3(1.6, 0, 0)).norm(), (p + Vector3(1.6, 0, 0)).norm()) - 2.0;
  });
  const CoarseGrid filled = closed(balls, 1.5);
  // Fillet of a ball of 1.5 that touches both: its centre is at ρ = √(3.5² − 1.6²).
  const double fillet = std::sqrt(3.5 * 3.5 - 1.6 * 1.6) - 1.5;
  EXPECT_GT(balls.linear({0, 0, fillet}), 0.2);
  EXPECT_NEAR(filled.linear({0, 0, fillet}), 0.0, 0.1);
  EXPECT_NEAR(filled.linear({3.6, 0, 0}), 0.0, 0.1);
  EXPECT_NEAR(filled.linear({1.6, 2.0, 0}), 0.0, 0.1);
}

}  // namespace
}  // namespace gnathion
