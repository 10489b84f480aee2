// Many signed distances at a time, against core's query one by one.
#include "evaluation/surface_distance.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>

#include "core/mesh_query.h"
#include "core/random.h"
#include "evaluation/distance_field.h"

namespace gnathion {
namespace {

/// An open, bumpy sheet over a square, normals up.
TriangleMesh sheet(int cells, double size_mm, Random& random) {
  TriangleMesh m;
  for (int j = 0; j <= cells; ++j)
    for (int i = 0; i <= cells; ++i) {
      const double x = size_mm * i / cells, y = size_mm * j / cells;
      m.vertices_mm.emplace_back(x, y, 0.8 * std::sin(x) * std::cos(0.7 * y) + 0.05 * random.normal());
    }
  const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(j * (cells + 1) + i); };
  for (int j = 0; j < cells; ++j)
    for (int i = 0; i < cells; ++i) {
      m.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      m.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  return m;
}

TriangleMesh sphere(double radius_mm, int cells) {
  TriangleMesh m;
  for (int j = 0; j <= cells; ++j)
    for (int i = 0; i < 2 * cells; ++i) {
      const double a = M_PI * i / cells, b = M_PI * j / cells;
      const double ring = j == 0 || j == cells ? 0.0 : std::sin(b);  // the poles are one point each
      m.vertices_mm.push_back(radius_mm * Vector3(ring * std::cos(a), ring * std::sin(a), std::cos(b)));
    }
  const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(j * 2 * cells + i % (2 * cells)); };
  for (int j = 0; j < cells; ++j)
    for (int i = 0; i < 2 * cells; ++i) {
      m.triangles.push_back({at(i, j), at(i, j + 1), at(i + 1, j + 1)});
      m.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i + 1, j)});
    }
  return m;
}

struct Found {
  std::vector<double> distance;
  std::vector<int> visits;
};
Found found_for(const TriangleMesh& mesh, const std::vector<Vector3>& points, const Rigid3& pose,
                double reach_mm) {
  Found f{std::vector<double>(points.size(), 0.0), std::vector<int>(points.size(), 0)};
  const SurfaceDistance surface(mesh);
  surface.for_each(points, pose, reach_mm, [&](std::size_t i, const SurfaceFoot& foot) {
    f.distance[i] = foot.signed_mm;
    ++f.visits[i];
  });
  return f;
}

TEST(SurfaceDistance, ExactlyWhatCoreFindsOneByOne) {
  Random random(31337);
  for (const double size : {5.0, 60.0}) {
    TriangleMesh mesh = sheet(60, size, random);
    mesh.triangles.push_back({0, 0, 5});  // and triangles without area
    mesh.triangles.push_back({3, 4, 4});
    const Rigid3 pose{random.rotation(), 10.0 * random.normal3()};
    std::vector<Vector3> points;
    for (int i = 0; i < 6000; ++i) {
      const Vector3 p(random.uniform(-2, size + 2), random.uniform(-2, size + 2), random.uniform(-6, 6));
      points.push_back(pose.inverse() * p);
    }
    for (std::size_t v = 0; v < mesh.vertices_mm.size(); v += 7)
      points.push_back(pose.inverse() * mesh.vertices_mm[v]);
    const MeshQuery query(mesh);
    const double reach = 4.0;
    const Found f = found_for(mesh, points, pose, reach);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const auto truth = query.signed_distance(pose * points[i], reach);
      ASSERT_EQ(f.visits[i], truth ? 1 : 0) << i;
      if (!truth) continue;
      EXPECT_NEAR(std::abs(f.distance[i]), std::abs(truth->distance_mm), 1e-12);
      // Away from the boundary (and from surface to the hair) the sides agree too.
      if (!truth->closest.on_boundary && std::abs(truth->distance_mm) > 1e-9) {
        EXPECT_EQ(f.distance[i] < 0.0, truth->distance_mm < 0.0) << i << " " << truth->distance_mm;
      }
    }
  }
}

TEST(SurfaceDistance, SignsOnAClosedBodyAreThoseOfTheWindingNumber) {
  Random random(8);
  const TriangleMesh ball = sphere(10.0, 12);  // coarse: edges and vertices are often the closest feature
  const MeshQuery query(ball);
  std::vector<Vector3> points;
  for (int i = 0; i < 3000; ++i) points.push_back(random.uniform(8.5, 11.5) * random.unit_vector());
  const SurfaceDistance surface(ball);
  EXPECT_TRUE(surface.closed());
  surface.for_each(points, Rigid3::identity(), 5.0, [&](std::size_t i, const SurfaceFoot& foot) {
    if (std::abs(foot.signed_mm) > 1e-6) {
      EXPECT_EQ(foot.signed_mm < 0.0, query.inside(points[i])) << i;
    }
  });
}

TEST(SurfaceDistance, SameAnswersOnOneThread) {
  Random random(9);
  const TriangleMesh mesh = sheet(80, 40.0, random);
  std::vector<Vector3> points(20000);
  for (Vector3& p : points) p = {random.uniform(0, 40), random.uniform(0, 40), random.normal()};
  const Found many = found_for(mesh, points, Rigid3::identity(), 3.0);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(many.distance, found_for(mesh, points, Rigid3::identity(), 3.0).distance);
}

TEST(SurfaceDistance, NothingWithinReachAndNothingAtAll) {
  Random random(10);
  const TriangleMesh mesh = sheet(4, 10.0, random);
  const Found far = found_for(mesh, {{5, 5, 100}, {std::nan(""), 0, 0}}, Rigid3::identity(), 3.0);
  EXPECT_EQ(far.visits, (std::vector<int>{0, 0}));
  EXPECT_EQ(found_for({}, {{0, 0, 0}}, Rigid3::identity(), 3.0).visits[0], 0);
}

TEST(DistanceField, PeripheralPointsAreFoundAndLeftOut) {
  // A flat model 20 mm wide; a scan 0.1 mm above it that reaches 1 mm beyond its rim, with a step at its end.
  const auto flat = [](double from, double to, double z, int cells) {
    TriangleMesh m;
    for (int j = 0; j <= cells; ++j)
      for (int i = 0; i <= cells; ++i)
        m.vertices_mm.emplace_back(from + (to - from) * i / cells, from + (to - from) * j / cells, z);
    const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(j * (cells + 1) + i); };
    for (int j = 0; j < cells; ++j)
      for (int i = 0; i < cells; ++i) {
        m.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
        m.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
      }
    return m;
  };
  const auto model = std::make_shared<const TriangleMesh>(flat(-10, 10, 0.0, 40));
  TriangleMesh scan_mesh = flat(-11, 11, 0.1, 110);
  for (Vector3& v : scan_mesh.vertices_mm)
    if (v.x() > 5.0 && v.x() < 5.6) v.z() += 3.0 * (v.x() - 5.0);  // a burr
  const FieldOptions options;
  const ScanFacts scan = facts_of(std::make_shared<const TriangleMesh>(scan_mesh), options);
  const SurfaceDistance surface(*model, 1.0);
  const DistanceField f = measure_field(scan, model, surface, Rigid3::identity(), {}, options);
  EXPECT_NEAR(f.core.avg_mm, 0.1, 0.03);
  EXPECT_LT(f.core.std_mm, 0.5 * f.all.std_mm);
  EXPECT_GT(f.beyond_rim, 300u);
  EXPECT_GT(f.boundary, 300u);
  EXPECT_GT(f.steep, 50u);
  EXPECT_EQ(f.all.n, scan_mesh.vertices_mm.size());
  EXPECT_EQ(f.core.n + f.beyond_rim + f.boundary + f.steep, f.all.n);
  for (std::size_t i = 0; i < f.use.size(); ++i) {
    const Vector3& v = scan_mesh.vertices_mm[i];
    const double out = std::max(std::abs(v.x()), std::abs(v.y())) - 10.0;
    const bool on_burr = v.x() > 4.9 && v.x() < 5.7;
    if (out > 0.2 && !on_burr) {
      EXPECT_EQ(f.use[i], PointUse::kBeyondRim);
    }
    if (out < -0.6 && (v.x() < 4.7 || v.x() > 5.9)) {
      EXPECT_EQ(f.use[i], PointUse::kCore);
    }
  }
  // Below the model the distances are negative, beyond the rim too.
  const DistanceField below =
      measure_field(scan, model, surface, Rigid3::from_translation({0, 0, -0.3}), {}, options);
  EXPECT_LT(below.all.avg_mm, -0.1);
}

}  // namespace
}  // namespace gnathion
