#include "core/mesh_query.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "core/mesh_io.h"
#include "core/mesh_test_shapes.h"

namespace gnathion {
namespace {

/// Smallest distance to a triangle by minimising over its plane and sides with a method of its own:
/// projected-gradient-free, by the seven cases in barycentric form.
double distance_by_cases(const Vector3& p, const Vector3& a, const Vector3& b, const Vector3& c) {
  const auto to_segment = [&](const Vector3& from, const Vector3& to) {
    const double s =
        std::clamp((p - from).dot(to - from) / std::max((to - from).squaredNorm(), 1e-300), 0.0, 1.0);
    return (p - (from + s * (to - from))).norm();
  };
  double best = std::min({to_segment(a, b), to_segment(b, c), to_segment(c, a)});
  // Least-squares foot in the plane.
  Eigen::Matrix<double, 3, 2> basis;
  basis << b - a, c - a;
  const Eigen::Vector2d st = (basis.transpose() * basis).ldlt().solve(basis.transpose() * (p - a));
  if (st.x() >= 0 && st.y() >= 0 && st.sum() <= 1) best = std::min(best, (p - a - basis * st).norm());
  return best;
}

double brute_force_distance(const TriangleMesh& mesh, const Vector3& p) {
  double best = 1e300;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    best = std::min(best, distance_by_cases(p, mesh.corner(i, 0), mesh.corner(i, 1), mesh.corner(i, 2)));
  return best;
}

TEST(MeshQuery, ClosestPointAgreesWithBruteForce) {
  for (std::uint64_t seed : {1u, 2u, 3u}) {
    Random random(seed);
    // Far from the origin, where single precision alone would be off by 0.06 mm.
    const Vector3 offset = seed == 3 ? Vector3(1e6, -2e6, 5e5) : Vector3(0, 0, 0);
    TriangleMesh mesh = test::spiky(4, seed);
    for (Vector3& v : mesh.vertices_mm) v += offset;
    const MeshQuery query(mesh);
    for (int i = 0; i < 300; ++i) {
      const Vector3 p = offset + random.unit_vector() * random.uniform(0.0, i % 10 == 0 ? 500.0 : 40.0);
      const auto found = query.closest(p);
      ASSERT_TRUE(found);
      const double expected = brute_force_distance(mesh, p);
      EXPECT_NEAR(found->distance_mm, expected, seed == 3 ? 1e-8 : 1e-10);
      EXPECT_NEAR((found->point_mm - p).norm(), found->distance_mm, 1e-8);
      EXPECT_NEAR(found->barycentric.sum(), 1.0, 1e-12);
      EXPECT_GE(found->barycentric.minCoeff(), 0.0);
      Vector3 rebuilt = Vector3::Zero();
      for (int k = 0; k < 3; ++k) rebuilt += found->barycentric[k] * mesh.corner(found->triangle, k);
      EXPECT_LT((rebuilt - found->point_mm).norm(), 1e-8);
      // A limit just below finds nothing, one just above finds the same.
      EXPECT_FALSE(query.closest(p, expected * (1 - 1e-9) - 1e-7));
      const auto limited = query.closest(p, expected * (1 + 1e-9) + 1e-7);
      ASSERT_TRUE(limited);
      EXPECT_EQ(limited->triangle, found->triangle);
    }
  }
}

TEST(MeshQuery, SignAgreesWithWindingNumberOnSharpFolds) {
  const TriangleMesh mesh = test::spiky(4, 11);
  const MeshQuery query(mesh);
  Random random(12);
  int inside = 0, checked = 0;
  for (int i = 0; i < 2000; ++i) {
    // Near vertices and edges too, where a face normal's sign would be wrong.
    const Vector3 p = i % 2 ? Vector3(random.unit_vector() * random.uniform(5.0, 32.0))
                            : Vector3(mesh.vertices_mm[random.below(std::uint32_t(mesh.vertices_mm.size()))] +
                                      random.normal3() * 0.5);
    const auto found = query.signed_distance(p);
    ASSERT_TRUE(found);
    if (std::abs(found->distance_mm) < 1e-9) continue;
    const double winding = query.winding_number(p);
    ASSERT_LT(std::min(std::abs(winding), std::abs(winding - 1.0)), 1e-9);
    EXPECT_EQ(found->distance_mm<0.0, winding> 0.5) << p.transpose();
    EXPECT_FALSE(found->closest.on_boundary);
    EXPECT_EQ(query.count_crossings(p, random.unit_vector()) % 2, winding > 0.5 ? 1 : 0);
    inside += winding > 0.5;
    ++checked;
  }
  EXPECT_GT(checked, 1900);
  EXPECT_GT(inside, 300);
  EXPECT_LT(inside, 1800);
}

TEST(MeshQuery, SignedDistanceOfSphereIsRadial) {
  const MeshQuery query(test::sphere(6, 20.0));
  Random random(5);
  for (int i = 0; i < 500; ++i) {
    const double r = random.uniform(0.5, 60.0);
    const auto found = query.signed_distance(random.unit_vector() * r);
    ASSERT_TRUE(found);
    EXPECT_NEAR(found->distance_mm, r - 20.0, 0.01);  // sagitta of the faces: 6 µm
  }
}

TEST(MeshQuery, OpenMeshHasNoSideBeyondItsRim) {
  const TriangleMesh mesh = test::sheet(10, 20.0, [](double, double) { return 0.0; });
  const MeshQuery query(mesh);
  const auto above = query.signed_distance({1.0, 2.0, 3.0}), below = query.signed_distance({1.0, 2.0, -3.0});
  EXPECT_DOUBLE_EQ(above->distance_mm, 3.0);
  EXPECT_DOUBLE_EQ(below->distance_mm, -3.0);
  EXPECT_FALSE(above->closest.on_boundary);
  for (const Vector3& p : {Vector3(13, 0, -4), Vector3(13, 14, -1), Vector3(-13, 1, 4)}) {
    const auto beyond = query.signed_distance(p);
    EXPECT_TRUE(beyond->closest.on_boundary);
    EXPECT_GT(beyond->distance_mm, 0.0);
  }
  // A bowl: inside() goes on where the sign gives up.
  TriangleMesh bowl = test::sphere(4, 10.0);
  std::vector<bool> keep;
  for (std::size_t i = 0; i < bowl.triangles.size(); ++i) keep.push_back(bowl.corner(i, 0).z() < 5.0);
  const MeshQuery open(submesh(bowl, keep));
  EXPECT_TRUE(open.inside({0, 0, 0}));
  EXPECT_FALSE(open.inside({0, 0, 9}));
  EXPECT_FALSE(open.inside({0, 0, -11}));
}

TEST(MeshQuery, UnweldedMeshHasTheSameSigns) {
  const TriangleMesh welded = test::spiky(3, 21);
  TriangleMesh soup;
  for (std::uint32_t i = 0; i < welded.triangles.size(); ++i) {
    for (int k = 0; k < 3; ++k) soup.vertices_mm.push_back(welded.corner(i, k));
    soup.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  const MeshQuery a(welded), b(soup);
  Random random(22);
  for (int i = 0; i < 500; ++i) {
    const Vector3 p = random.unit_vector() * random.uniform(0.0, 35.0);
    const auto x = a.signed_distance(p), y = b.signed_distance(p);
    EXPECT_DOUBLE_EQ(x->distance_mm, y->distance_mm);
    EXPECT_FALSE(y->closest.on_boundary);
  }
}

TEST(MeshQuery, DegenerateTrianglesDoNoHarm) {
  TriangleMesh mesh = test::box({0, 0, 0}, {10, 10, 10});
  const auto n = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  mesh.vertices_mm.emplace_back(20, 0, 0);
  mesh.vertices_mm.emplace_back(30, 0, 0);
  mesh.triangles.push_back({n, n, n});
  mesh.triangles.push_back({n, n + 1, n});
  const MeshQuery query(mesh);
  EXPECT_NEAR(query.closest({25, 3, 4})->distance_mm, 5.0, 1e-12);
  EXPECT_NEAR(query.closest({18, 0, 0})->distance_mm, 2.0, 1e-12);
  EXPECT_NEAR(query.signed_distance({5, 5, 4})->distance_mm, -4.0, 1e-12);
  EXPECT_FALSE(query.ray({25, 0, 5}, {0, 0, -1}));
}

TEST(MeshQuery, EmptyMeshAndBadPointsFindNothing) {
  const MeshQuery empty((TriangleMesh()));
  EXPECT_FALSE(empty.closest({0, 0, 0}));
  EXPECT_FALSE(empty.ray({0, 0, 0}, {0, 0, 1}));
  EXPECT_EQ(empty.count_crossings({0, 0, 0}, {0, 0, 1}), 0);
  EXPECT_EQ(empty.winding_number({0, 0, 0}), 0.0);
  const MeshQuery query(test::tetrahedron());
  EXPECT_FALSE(query.closest({NAN, 0, 0}));
  EXPECT_FALSE(query.closest({50, 0, 0}, 1.0));
}

/// All crossings by the plane equation and three side tests.
std::vector<double> brute_force_crossings(const TriangleMesh& mesh, const Vector3& o, const Vector3& d) {
  std::vector<double> found;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Vector3 a = mesh.corner(i, 0), b = mesh.corner(i, 1), c = mesh.corner(i, 2),
                  n = (b - a).cross(c - a);
    const double t = n.dot(a - o) / n.dot(d);
    const Vector3 q = o + t * d;
    if (t > 0 && n.dot((b - a).cross(q - a)) >= 0 && n.dot((c - b).cross(q - b)) >= 0 &&
        n.dot((a - c).cross(q - c)) >= 0)
      found.push_back(t);
  }
  std::sort(found.begin(), found.end());
  return found;
}

TEST(MeshQuery, RaysAgreeWithBruteForce) {
  const TriangleMesh mesh = test::spiky(4, 31);
  const MeshQuery query(mesh);
  Random random(32);
  int hits = 0;
  for (int i = 0; i < 1000; ++i) {
    const double far = i % 5 == 0 ? 1e5 : 40.0;  // starts far away lose nothing
    const Vector3 o = random.unit_vector() * random.uniform(0.0, far);
    const Vector3 d = (random.unit_vector() * 15.0 - o).normalized();
    const std::vector<double> expected = brute_force_crossings(mesh, o, d);
    const auto hit = query.ray(o, d);
    ASSERT_EQ(hit.has_value(), !expected.empty());
    EXPECT_EQ(query.count_crossings(o, d), int(expected.size()));
    if (!hit) continue;
    ++hits;
    EXPECT_NEAR(hit->distance_mm, expected[0], 1e-12 * far + 1e-10);
    EXPECT_NEAR(std::abs(face_normals(mesh)[hit->triangle].dot(hit->normal)), 1.0, 1e-12);
    // From beyond the first hit on, the second comes first.
    const auto second = query.ray(o, d, expected[0] + 1e-6);
    ASSERT_EQ(second.has_value(), expected.size() > 1);
    if (second) {
      EXPECT_NEAR(second->distance_mm, expected[1], 1e-12 * far + 1e-10);
    }
    EXPECT_FALSE(query.ray(o, d, 0.0, expected[0] - 1e-6));
  }
  EXPECT_GT(hits, 500);
}

TEST(MeshQuery, NoRaySlipsThroughAnEdge) {
  const TriangleMesh mesh = test::sphere(3, 20.0);
  const MeshQuery query(mesh);
  Random random(41);
  for (const Triangle& t : mesh.triangles) {
    const Vector3& a = mesh.vertices_mm[t[0]];
    const Vector3& b = mesh.vertices_mm[t[1]];
    const double s = random.uniform();
    const Vector3 o = random.normal3();  // inside
    for (const Vector3& target : {a, b, Vector3((1 - s) * a + s * b)}) {
      const Vector3 d = (target - o).normalized();
      EXPECT_TRUE(query.ray(o, d));
      EXPECT_EQ(query.count_crossings(o, d) % 2, 1);
      EXPECT_EQ(query.count_crossings(o - 100.0 * d, d), 2);
    }
  }
  // Along the axes through vertices and edges of a cube.
  const MeshQuery cube(test::box({-1, -1, -1}, {1, 1, 1}));
  for (int k = 0; k < 3; ++k) EXPECT_EQ(cube.count_crossings({0, 0, 0}, Vector3::Unit(k)), 1);
  EXPECT_EQ(cube.count_crossings({0, 0, 0}, Vector3(1, 1, 1).normalized()), 1);
}

TEST(MeshQuery, WindingNumberOfOpenMeshIsItsShareOfTheSphere) {
  // One side of a cube seen from its middle covers a sixth.
  TriangleMesh side = test::box({-1, -1, -1}, {1, 1, 1});
  side.triangles.resize(2);
  EXPECT_NEAR(MeshQuery(side).winding_number({0, 0, 0}), 1.0 / 6.0, 1e-12);
  EXPECT_NEAR(MeshQuery(side).winding_number({0, 0, -2}), -1.0 / 6.0, 1e-12);
}

TEST(MeshQuery, ThreadsGetTheSameAnswers) {
  const TriangleMesh mesh = test::spiky(4, 51);
  const MeshQuery query(mesh);
  Random random(52);
  std::vector<Vector3> points(2000);
  for (Vector3& p : points) p = random.unit_vector() * random.uniform(0.0, 40.0);
  std::vector<SignedDistance> alone;
  for (const Vector3& p : points) alone.push_back(*query.signed_distance(p));
  std::atomic<int> different{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (std::size_t i = 0; i < points.size(); ++i) {
        const auto found = query.signed_distance(points[i]);
        if (found->distance_mm != alone[i].distance_mm ||
            found->closest.triangle != alone[i].closest.triangle)
          ++different;
      }
    });
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(different, 0);
}

TEST(MeshQuery, RealCrownsSignsAgreeWithWindingNumber) {
  const auto data = test::shared_data();
  if (data.empty()) GTEST_SKIP() << "skipped: the shared data folder is not here";
  auto mesh = read_jaw(data / "jaws/crowns/maxilla.stl");
  ASSERT_TRUE(mesh) << mesh.error().line();
  const MeshQuery query(*mesh);
  const Box box = bounding_box(*mesh);
  Random random(61);
  int disagree = 0;
  for (int i = 0; i < 200; ++i) {
    Vector3 p =
        mesh->vertices_mm[random.below(std::uint32_t(mesh->vertices_mm.size()))] + 0.6 * random.normal3();
    if (i % 4 == 0)
      for (int k = 0; k < 3; ++k) p[k] = random.uniform(box.min_mm[k], box.max_mm[k]);
    disagree += (query.signed_distance(p)->distance_mm < 0.0) != (query.winding_number(p) > 0.5);
  }
  // The scan overlaps itself in places (crowns touch), where the two rules may differ.
  EXPECT_LE(disagree, 4);
}

}  // namespace
}  // namespace gnathion
