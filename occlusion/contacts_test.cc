#include "occlusion/contacts.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "core/random.h"
#include "occlusion/test_jaws.h"

namespace gnathion {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// A square sheet in z = 0 with normals along +z, side 20 mm, step 0.4 mm; triangles whose centre lies
/// within hole_mm of `hole` are left out.
TriangleMesh sheet(double hole_mm = 0.0, const Vector3& hole = Vector3::Zero()) {
  TriangleMesh mesh;
  const int n = 50;
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j) mesh.vertices_mm.emplace_back(-10.0 + 0.4 * i, -10.0 + 0.4 * j, 0.0);
  auto add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const Vector3 centre = (mesh.vertices_mm[a] + mesh.vertices_mm[b] + mesh.vertices_mm[c]) / 3.0;
    if ((centre - hole).norm() >= hole_mm) mesh.triangles.push_back({a, b, c});
  };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      const auto a = static_cast<std::uint32_t>(i * (n + 1) + j), b = a + static_cast<std::uint32_t>(n) + 1;
      add(a, b, b + 1);
      add(a, b + 1, a + 1);
    }
  return mesh;
}

/// A closed box with outward normals.
TriangleMesh box(const Vector3& low, const Vector3& high) {
  TriangleMesh mesh;
  for (int k = 0; k < 8; ++k)
    mesh.vertices_mm.emplace_back(k & 1 ? high.x() : low.x(), k & 2 ? high.y() : low.y(),
                                  k & 4 ? high.z() : low.z());
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return mesh;
}

/// A closed sphere by latitude and longitude.
TriangleMesh sphere(double radius, const Vector3& centre, int n = 160) {
  TriangleMesh mesh;
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j < 2 * n; ++j) {
      const double theta = kPi * i / n, phi = kPi * j / n;
      mesh.vertices_mm.push_back(centre + radius * Vector3(std::sin(theta) * std::cos(phi),
                                                           std::sin(theta) * std::sin(phi), std::cos(theta)));
    }
  auto id = [&](int i, int j) { return static_cast<std::uint32_t>(i * 2 * n + j % (2 * n)); };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < 2 * n; ++j) {
      if (i > 0) mesh.triangles.push_back({id(i, j), id(i + 1, j), id(i, j + 1)});
      if (i < n - 1) mesh.triangles.push_back({id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)});
    }
  return mesh;
}

TEST(SampleSurface, KeepsAreaAndCentroid) {
  Random random(41);
  TriangleMesh mesh;
  for (int k = 0; k < 20; ++k) {
    for (int c = 0; c < 3; ++c) mesh.vertices_mm.push_back(2.0 * random.normal3());
    const auto v = static_cast<std::uint32_t>(3 * k);
    mesh.triangles.push_back({v, v + 1, v + 2});
  }
  const auto samples = sample_surface(mesh, 0.2);
  double area = 0.0;
  Vector3 centroid = Vector3::Zero();
  for (const auto& s : samples) {
    area += s.area_mm2;
    centroid += s.area_mm2 * s.p_mm;
    const Triangle& t = mesh.triangles[s.triangle];
    EXPECT_TRUE(s.vertex == t[0] || s.vertex == t[1] || s.vertex == t[2]);
  }
  EXPECT_NEAR(area, surface_area_mm2(mesh), 1e-9 * area);
  EXPECT_LT((centroid / area - surface_centroid_mm(mesh)).norm(), 1e-9);
}

TEST(InsideSurface, HoldsAtScanHolesAndOpenBases) {
  // A box without its top face: a scan with a base but a missing roof, looked at from below.
  TriangleMesh open = box({-5, -5, 0}, {5, 5, 4});
  open.triangles.erase(open.triangles.begin() + 2, open.triangles.begin() + 4);
  const MeshQuery roofless(open);
  Random random(5);
  for (int k = 0; k < 300; ++k) {
    const Vector3 p(random.uniform(-6, 6), random.uniform(-6, 6), random.uniform(-1, 3.9));
    const bool inside = std::abs(p.x()) < 5 && std::abs(p.y()) < 5 && p.z() > 0;
    EXPECT_EQ(inside_surface(roofless, p, -Vector3::UnitZ()), inside) << p.transpose();
  }
}

TEST(FindOverlap, DepthAndVolumeOfASphereInABlock) {
  // The lower block's top is z = 0; a sphere of radius 6 dips 0.3 mm into it: a cap of height h.
  const double h = 0.3, r = 6.0;
  const MeshQuery maxilla(sphere(r, {0.4, -0.3, r - h}));
  const MeshQuery mandible(box({-10, -10, -8}, {10, 10, 0}));
  const auto overlap = find_overlap(maxilla, mandible, Rigid3::identity(), Vector3::UnitZ(), 0.1);
  EXPECT_NEAR(overlap.depth_mm, h, 0.005);
  EXPECT_LT((overlap.where_mm - Vector3(0.4, -0.3, -h)).norm(), 0.3);
  EXPECT_NEAR(overlap.area_mm2, kPi * h * (2 * r - h), 0.05 * kPi * h * 2 * r);
  EXPECT_NEAR(overlap.volume_mm3, kPi * h * h * (r - h / 3), 0.06 * kPi * h * h * r);
  EXPECT_EQ(overlap.min_distance_mm, 0.0);

  // Lowered by 0.75 mm the block is 0.45 mm away, under the sphere's pole.
  const Rigid3 down = Rigid3::from_translation({0, 0, -0.75});
  const auto apart = find_overlap(maxilla, mandible, down, Vector3::UnitZ(), 0.1);
  EXPECT_EQ(apart.depth_mm, 0.0);
  EXPECT_NEAR(apart.min_distance_mm, 0.45, 0.005);
  EXPECT_NEAR(apart.closest_mm.z(), -0.5, 0.3);
}

TEST(FindOverlap, SeesEdgesThatCrossWithoutAVertexInside) {
  // A roof's ridge between two far vertices sinks into a block: no vertex of the roof is inside.
  TriangleMesh roof;
  roof.vertices_mm = {{-20, 0, -0.2}, {20, 0, -0.2}, {-20, 5, 5}, {20, 5, 5}, {-20, -5, 5}, {20, -5, 5}};
  roof.triangles = {{0, 2, 1}, {1, 2, 3}, {0, 1, 4}, {1, 5, 4}};
  ASSERT_LT(face_normal_scaled(roof, 0).z(), 0.0);
  const MeshQuery maxilla(roof), mandible(box({-3, -8, -6}, {3, 8, 0}));
  const auto overlap = find_overlap(maxilla, mandible, Rigid3::identity(), Vector3::UnitZ());
  EXPECT_NEAR(overlap.maxilla_depth_mm, 0.2, 0.05);
}

TEST(FindContacts, AreaOfASphereOnASheetAndItsSides) {
  // A sphere sunk 0.02 mm: what is within 0.05 mm of the sheet is a cap of height 0.07 mm.
  ArchFrame frame;
  const double r = 10.0;
  for (const double side : {-1.0, 1.0}) {
    const auto ball = sphere(r, {4.0 * side, 0.0, r - 0.02}, 240);
    std::vector<std::uint8_t> fdi(ball.vertices_mm.size(), side > 0 ? 36 : 43);
    const MeshQuery opposing(sheet());
    const auto contacts =
        find_contacts(ball, fdi, Rigid3::identity(), opposing, Vector3::UnitZ(), frame, 0.05, 0.05);
    const double expected = 2.0 * kPi * r * 0.07;
    EXPECT_NEAR(contacts.area_mm2, expected, 0.03 * expected);
    EXPECT_NEAR(side > 0 ? contacts.left_area_mm2 : contacts.right_area_mm2, contacts.area_mm2, 1e-12);
    ASSERT_EQ(contacts.patches.size(), 1u);
    EXPECT_LT((contacts.patches[0].centre_mm - Vector3(4.0 * side, 0, 0)).norm(), 0.05);
    ASSERT_EQ(contacts.per_tooth.size(), 1u);
    EXPECT_EQ(contacts.per_tooth[0].fdi, fdi[0]);
    EXPECT_EQ(contacts.front_area_mm2 > 0.0, side < 0);  // 43 is a canine, 36 a molar
  }
}

TEST(FindContacts, TwoSpheresAreTwoPatches) {
  const auto balls = merged(sphere(5.0, {-6, 0, 5.02}), sphere(5.0, {6, 0, 4.99}));
  const MeshQuery opposing(sheet());
  const auto contacts =
      find_contacts(balls, {}, Rigid3::identity(), opposing, Vector3::UnitZ(), ArchFrame{}, 0.05, 0.05);
  ASSERT_EQ(contacts.patches.size(), 2u);
  EXPECT_GT(contacts.patches[0].centre_mm.x(), 5.0) << "the deeper one is larger and comes first";
  EXPECT_NEAR(contacts.patches[0].area_mm2 / contacts.patches[1].area_mm2, 0.06 / 0.03, 0.25);
}

TEST(SignedGaps, DoNotDependOnPoseAndMarkTheFarSide) {
  const auto ball = sphere(6.0, {0, 0, 0}, 60);
  Random random(77);
  std::vector<Vector3> points;
  for (int k = 0; k < 500; ++k) points.push_back(random.uniform(4.0, 8.0) * random.unit_vector());
  const Rigid3 x{random.rotation(), 50.0 * random.normal3()};
  const MeshQuery query(transformed(x, ball));
  const auto gaps = signed_gaps_mm(points, x, query, x.rotation * Vector3::UnitZ(), 1.5);
  for (std::size_t k = 0; k < points.size(); ++k) {
    const double truth = points[k].norm() - 6.0;
    if (std::abs(truth) < 1.45) {
      EXPECT_NEAR(gaps[k], truth, 0.01);
    } else if (std::abs(truth) > 1.52) {
      EXPECT_TRUE(std::isinf(gaps[k]));
    }
  }
}

TEST(ToothClearances, AreSignedAlongTheOcclusalNormal) {
  const auto jaws = testing::simple_jaws(0.0);
  const auto frame = find_arch(jaws.maxilla, jaws.mandible);
  ASSERT_TRUE(frame) << frame.error().line();
  const MeshQuery maxilla(jaws.maxilla);
  auto at = [&](const Vector3& t) {
    return tooth_clearances(maxilla, jaws.maxilla_fdi, jaws.mandible, jaws.mandible_fdi,
                            Rigid3::from_translation(t), *frame);
  };
  const auto lowered = at({0, 0, -2});
  ASSERT_EQ(lowered.size(), 14u);
  for (const auto& tooth : lowered) {
    EXPECT_NEAR(tooth.min_mm, 2.0, 0.1) << int{tooth.fdi};  // flat tables, 2 mm apart
    EXPECT_GT(tooth.vertical_median_mm, 1.9) << int{tooth.fdi};
    EXPECT_GT(tooth.opposed_fraction, 0.5) << int{tooth.fdi};
  }
  for (const auto& tooth : at({0, 0, 20})) {
    EXPECT_LT(tooth.vertical_median_mm, -10.0) << "above the maxilla and touching nothing";
    EXPECT_LT(tooth.min_mm, -10.0);
  }
}

}  // namespace
}  // namespace gnathion
