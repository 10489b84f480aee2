#include "design/settling.h"

#include <gtest/gtest.h>

namespace gnathion {
namespace {

/// A closed box.
TriangleMesh box_between(const Vector3& low, const Vector3& high, int cells) {
  TriangleMesh mesh;
  // Six faces of cells × cells squares; corners are shared by place, which is all that queries need.
  const auto face = [&](const Vector3& origin, const Vector3& u, const Vector3& v) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices_mm.size());
    const auto n = static_cast<std::uint32_t>(cells);
    for (std::uint32_t i = 0; i <= n; ++i)
      for (std::uint32_t j = 0; j <= n; ++j)
        mesh.vertices_mm.push_back(origin + u * (static_cast<double>(i) / cells) +
                                   v * (static_cast<double>(j) / cells));
    for (std::uint32_t i = 0; i < n; ++i)
      for (std::uint32_t j = 0; j < n; ++j) {
        const std::uint32_t a = first + i * (n + 1) + j, b = a + n + 1;
        mesh.triangles.push_back({a, b, b + 1});
        mesh.triangles.push_back({a, b + 1, a + 1});
      }
  };
  const Vector3 d = high - low;
  const Vector3 x(d.x(), 0, 0), y(0, d.y(), 0), z(0, 0, d.z());
  face(low, y, x);
  face(low + z, x, y);
  face(low, x, z);
  face(low + y, z, x);
  face(low, z, y);
  face(low + x, y, z);
  return mesh;
}

const MeshQuery& table() {
  static const MeshQuery instance(box_between({-20, -20, -5}, {20, 20, 0}, 40));
  return instance;
}

TEST(Settling, AFlatBodyComesDownByItsGap) {
  const MeshQuery body(box_between({-4, -3, 0.08}, {4, 3, 2}, 20));
  const auto points = touch_points(table(), body, {}, 0.3);
  const Settled s = settled(points, {{0, 0, -50}, {0.5, 0.3, 1}});
  EXPECT_TRUE(s.at_rest);
  const Vector3 moved = s.motion * Vector3(0, 0, 0.08) - Vector3(0, 0, 0.08);
  EXPECT_NEAR(moved.z(), -0.08, 1e-3);
  EXPECT_LT(moved.head<2>().norm(), 1e-3);
  EXPECT_LT(s.deepest_mm, 1e-3);
  EXPECT_LT(s.motion.angle_rad(), 1e-3);
}

TEST(Settling, ATiltedBodyComesDownFlat) {
  const double tilt = 0.01;
  const Rigid3 lean = Rigid3::about_axis({0, 0, 0}, Vector3::UnitY(), tilt);
  const MeshQuery body(
      transformed(Rigid3::from_translation({0, 0, 0.1}) * lean, box_between({-5, -4, 0}, {5, 4, 2}, 25)));
  const Settled s = settled(touch_points(table(), body, {}, 0.4), {{0, 0, -50}, {0, 0, 1}});
  EXPECT_TRUE(s.at_rest);
  const Rigid3 total = s.motion * Rigid3::from_translation({0, 0, 0.1}) * lean;
  EXPECT_NEAR((total.rotation * Vector3::UnitZ()).z(), 1.0, 1e-6);
  EXPECT_NEAR((total * Vector3::Zero()).z(), 0.0, 2e-3);
}

TEST(Settling, AnOverlappingBodyIsPushedOut) {
  const MeshQuery body(box_between({-4, -3, -0.02}, {4, 3, 2}, 20));
  const Settled s = settled(touch_points(table(), body, {}, 0.3), {{0, 0, -50}, {0, 0, 1}});
  EXPECT_NEAR((s.motion * Vector3::Zero()).z(), 0.02, 1e-3);
}

TEST(Settling, ABodyBetweenWallsGoesToThem) {
  // A slot of 6 mm with a body of 5.8: pushed sideways it moves by its play of 0.1 mm on each side.
  TriangleMesh slot = box_between({-20, -20, -5}, {20, 20, 0}, 20);
  const auto append = [&](const TriangleMesh& other) {
    const auto base = static_cast<std::uint32_t>(slot.vertices_mm.size());
    slot.vertices_mm.insert(slot.vertices_mm.end(), other.vertices_mm.begin(), other.vertices_mm.end());
    for (const Triangle& t : other.triangles)
      slot.triangles.push_back({t[0] + base, t[1] + base, t[2] + base});
  };
  append(box_between({-20, 3, 0.001}, {20, 8, 4}, 20));
  append(box_between({-20, -8, 0.001}, {20, -3, 4}, 20));
  const MeshQuery body(box_between({-4, -2.9, 0.02}, {4, 2.9, 2}, 20));
  const auto points = touch_points(MeshQuery(slot), body, {}, 0.3);
  for (const double side : {1.0, -1.0}) {
    const Settled s = settled(points, {{0, side * 5, -1}, {0, 0, 1}});
    EXPECT_TRUE(s.at_rest);
    EXPECT_NEAR((s.motion * Vector3(0, 0, 1)).y(), side * 0.1, 2e-3);
  }
}

TEST(Settling, WhatNothingHoldsIsTold) {
  const MeshQuery body(box_between({-4, -3, 0.05}, {4, 3, 2}, 20));
  const auto points = touch_points(table(), body, {}, 0.3);
  EXPECT_FALSE(settled(points, {{0, 0, 50}, {0, 0, 1}}).at_rest);
  // Pressed beyond its support it tips over.
  EXPECT_FALSE(settled(points, {{0, 0, -50}, {9, 0, 1}}).at_rest);
}

}  // namespace
}  // namespace gnathion
