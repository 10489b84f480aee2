#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh_query.h"
#include "core/random.h"

namespace gnathion {
namespace {

/// A rough closed ball: triangles of very different sizes.
TriangleMesh rough_ball(std::uint64_t seed, int rings) {
  Random random(seed);
  TriangleMesh mesh;
  const int around = 2 * rings;
  for (int i = 0; i <= rings; ++i)
    for (int j = 0; j < around; ++j) {
      const double a = M_PI * std::pow(double(i) / rings, 1.5), b = 2 * M_PI * j / around;
      const double r = 20.0 + (i == 0 || i == rings ? 0.0 : 0.3 * random.normal());
      mesh.vertices_mm.push_back(r *
                                 Vector3(std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a)));
    }
  const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(i * around + j % around); };
  for (int i = 0; i < rings; ++i)
    for (int j = 0; j < around; ++j) {
      mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  return welded_exactly(mesh);
}

std::vector<Vector3> points_about(const TriangleMesh& mesh, std::uint64_t seed, int count) {
  Random random(seed);
  std::vector<Vector3> points;
  for (int i = 0; i < count; ++i) {
    const Vector3& v = mesh.vertices_mm[random.below(static_cast<std::uint32_t>(mesh.vertices_mm.size()))];
    const double spread = i % 10 == 0 ? 5.0 : 0.3;
    points.push_back(v + spread * random.normal3());
  }
  for (int i = 0; i < 50; ++i) points.push_back(mesh.vertices_mm[static_cast<std::size_t>(i) * 3]);
  points.push_back(Vector3(1e5, -1e5, 3));
  points.push_back(Vector3::Constant(std::nan("")));
  return points;
}

class ClosestPoints : public testing::TestWithParam<double> {};

TEST_P(ClosestPoints, AreThoseOfSingleQueriesToTheLastBit) {
  const double reach = GetParam();
  const MeshQuery query(rough_ball(71, 60));
  const std::vector<Vector3> points = points_about(query.mesh(), 72, 20000);
  const std::vector<ClosestHit> hits = closest_points(query, points, reach);
  ASSERT_EQ(hits.size(), points.size());
  std::size_t found = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto single = query.signed_distance(points[i], reach);
    ASSERT_EQ(single.has_value(), hits[i].triangle != ClosestHit::kNoTriangle) << i;
    if (!single) continue;
    ++found;
    EXPECT_EQ(single->distance_mm, hits[i].distance_mm) << i;
    EXPECT_EQ(single->closest.triangle, hits[i].triangle) << i;
    EXPECT_EQ(single->closest.point_mm, hits[i].point_mm) << i;
    EXPECT_EQ(single->closest.normal, hits[i].normal) << i;
  }
  EXPECT_GT(found, reach < 0.1 ? 500u : 5000u);
}

INSTANTIATE_TEST_SUITE_P(Reaches, ClosestPoints,
                         testing::Values(0.05, 0.5, 10.0, std::numeric_limits<double>::infinity()));

TEST(LocalQuery, AnswersForEveryPointOfItsBall) {
  const MeshQuery query(rough_ball(5, 40));
  Random random(6);
  LocalQuery local(query);
  for (int ball = 0; ball < 300; ++ball) {
    const Vector3 centre = 20.0 * random.normal3().normalized() + 2.0 * random.normal3();
    const double radius = 0.2 + 2.0 * random.uniform(), reach = 3.0 * random.uniform();
    const bool any = local.gather(centre, radius, reach);
    for (int i = 0; i < 20; ++i) {
      const Vector3 p = centre + radius * random.uniform() * random.normal3().normalized();
      const auto a = query.closest(p, reach);
      const auto b = any ? local.closest(p, reach) : std::nullopt;
      ASSERT_EQ(a.has_value(), b.has_value());
      if (a) {
        EXPECT_EQ(a->triangle, b->triangle);
      }
    }
  }
}

/// Triangles of every shape, from needles and specks to none at all, some twice.
TriangleMesh soup(std::uint64_t seed) {
  Random random(seed);
  TriangleMesh mesh;
  for (int i = 0; i < 600; ++i) {
    const Vector3 a = 3.0 * random.normal3(),
                  along = std::pow(10.0, -4.0 * random.uniform()) * random.normal3();
    const Vector3 across = std::pow(10.0, -9.0 * random.uniform()) * random.normal3();
    const auto first = static_cast<std::uint32_t>(mesh.vertices_mm.size());
    for (const Vector3& v : {a, Vector3(a + along), Vector3(a + random.uniform() * along + across)})
      mesh.vertices_mm.push_back(v);
    mesh.triangles.push_back({first, first + 1, first + 2});
    if (i % 50 == 0) mesh.triangles.push_back({first, first + 1, first + 1});
    if (i % 20 == 0) mesh.triangles.push_back({first + 1, first + 2, first});
  }
  return mesh;
}

TEST(LocalQuery, AnswersToTheLastBitWhateverTheTrianglesShape) {
  for (const double far_mm : {0.0, 300.0}) {
    TriangleMesh mesh = soup(7);
    for (Vector3& v : mesh.vertices_mm) v.x() += far_mm;
    const MeshQuery query(std::move(mesh));
    Random random(8);
    LocalQuery local(query);
    int found = 0;
    for (int ball = 0; ball < 400; ++ball) {
      const Vector3 centre = 3.0 * random.normal3() + Vector3(far_mm, 0.0, 0.0);
      const double radius = std::pow(10.0, -3.0 * random.uniform()), reach = 2.0 * random.uniform();
      if (!local.gather(centre, radius, reach)) continue;
      for (int i = 0; i < 20; ++i) {
        // Some on the triangles themselves, where every neighbour is as near.
        Vector3 p = centre + radius * random.uniform() * random.normal3().normalized();
        if (i % 4 == 0) {
          const Vector3& v = query.mesh().vertices_mm[random.below(static_cast<std::uint32_t>(query.mesh().vertices_mm.size()))];
          if ((v - centre).norm() < radius) p = v;
        }
        const auto a = query.closest(p, reach), b = local.closest(p, reach);
        ASSERT_EQ(a.has_value(), b.has_value());
        if (!a) continue;
        ++found;
        EXPECT_EQ(a->triangle, b->triangle);
        EXPECT_EQ(a->distance_mm, b->distance_mm);
        EXPECT_EQ(a->point_mm, b->point_mm);
      }
    }
    EXPECT_GT(found, 2000);
  }
}

}  // namespace
}  // namespace gnathion
