#include <gtest/gtest.h>

#include <chrono>
#include <set>

#include "core/mesh_io.h"
#include "core/mesh_query.h"
#include "core/mesh_test_shapes.h"
#include "core/triangle_intersection.h"
#include "core/triangle_predicates.h"

namespace gnathion {
namespace {

using Pairs = std::vector<std::array<std::uint32_t, 2>>;
using Wide = __int128;

Vector3 grid_point(Random& random, int size) {
  const auto coordinate = [&] { return double(random.below(std::uint32_t(2 * size + 1))) - size; };
  const double x = coordinate(), y = coordinate(), z = coordinate();
  return {x, y, z};
}

Wide determinant(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d) {
  Wide m[3][3];
  const Vector3* rows[3] = {&a, &b, &c};
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) m[i][k] = Wide((*rows[i])[k]) - Wide(d[k]);
  return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
         m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
         m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}
int sign_of(Wide v) {
  return v > 0 ? 1 : v < 0 ? -1 : 0;
}

TEST(TrianglePredicates, SignsAreExactNearTheirZero) {
  Random random(1);
  int zeros = 0, tiny = 0;
  for (int i = 0; i < 20000; ++i) {
    // d = an integer combination of a, b, c, moved by one grid step or none, at 2^38: far beyond what doubles
    // resolve in a determinant, and still exact in 128-bit integers.
    const double scale = std::ldexp(1.0, i % 3 == 0 ? 28 : 20);
    Vector3 a = grid_point(random, 1000), b = grid_point(random, 1000);
    a = (a * scale).array().round() + grid_point(random, 3).array();
    b = (b * scale).array().round() + grid_point(random, 3).array();
    const Vector3 origin = grid_point(random, 1 << 20);
    const Vector3 c = origin + a, d = origin + b, e = origin + a + b;
    Vector3 f = origin;
    f[int(random.below(3))] += double(random.below(3)) - 1.0;
    const int expected = sign_of(determinant(c, d, e, f));
    ASSERT_EQ(orient3d_sign(c, d, e, f), expected);
    ASSERT_EQ(orient3d_sign(d, c, e, f), -expected);
    zeros += expected == 0;
    tiny += expected != 0;
  }
  EXPECT_GT(zeros, 3000);
  EXPECT_GT(tiny, 3000);
}

TEST(TrianglePredicates, FractionsThatDoublesCannotHoldAreTakenAsTheyAre) {
  // 0.1 + 0.2 ≠ 0.3: the third point is 5.6e-17 beside the line, and the sign says on which side.
  const Vector3 a(0, 0, 0), b(1, 1, 0), on(0.3, 0.3, 0), off(0.3, 0.1 + 0.2, 0);
  EXPECT_EQ(orient2d_sign(a, b, on, 0, 1), 0);
  EXPECT_EQ(orient2d_sign(a, b, off, 0, 1), 1);
  EXPECT_EQ(orient3d_sign(a, b, {0, 0, 1}, off), -orient3d_sign(a, b, {0, 0, 1}, {0.1 + 0.2, 0.3, 0}));
  EXPECT_NE(orient3d_sign(a, b, {0, 0, 1}, off), 0);
  EXPECT_EQ(orient3d_sign(a, b, {0, 0, 1}, on), 0);
}

/// Exact rational decision by another way than the code's: clip q's plane section of p against q, all in
/// integers, is laborious; instead the common points are sought as a linear programme over small integers.
/// Fourier–Motzkin on barycentric weights: p(u,v) = q(s,t), five inequalities each, exact in rationals.
struct Fraction {
  Wide n = 0, d = 1;
};
Wide gcd(Wide a, Wide b) {
  return b == 0 ? (a < 0 ? -a : a) : gcd(b, a % b);
}
Fraction make(Wide n, Wide d) {
  if (d < 0) n = -n, d = -d;
  const Wide g = gcd(n, d);
  return g == 0 ? Fraction{0, 1} : Fraction{n / g, d / g};
}
Fraction operator+(Fraction a, Fraction b) {
  return make(a.n * b.d + b.n * a.d, a.d * b.d);
}
Fraction operator-(Fraction a, Fraction b) {
  return make(a.n * b.d - b.n * a.d, a.d * b.d);
}
Fraction operator*(Fraction a, Fraction b) {
  return make(a.n * b.n, a.d * b.d);
}
Fraction operator/(Fraction a, Fraction b) {
  return make(a.n * b.d, a.d * b.n);
}
int sign_of(Fraction a) {
  return sign_of(a.n);
}
using Point = std::array<Fraction, 3>;

/// Clips a convex polygon by the half-space {x : side(x) ≥ 0} (Sutherland–Hodgman, exact, closed).
template <class Side>
std::vector<Point> clipped(const std::vector<Point>& polygon, Side&& side) {
  std::vector<Point> out;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const Fraction sa = side(a), sb = side(b);
    if (sign_of(sa) >= 0) out.push_back(a);
    if (sign_of(sa) * sign_of(sb) >= 0) continue;
    const Fraction s = sa / (sa - sb);
    Point middle;
    for (std::size_t k = 0; k < 3; ++k) middle[k] = a[k] + s * (b[k] - a[k]);
    out.push_back(middle);
  }
  return out;
}

/// The common part of two triangles as the corners of a polygon: p clipped to q's plane from both sides, then
/// to q's three sides.
std::vector<Point> common_part(const std::array<Vector3, 3>& p, const std::array<Vector3, 3>& q) {
  const auto exact = [](const Vector3& v) {
    return Point{Fraction{Wide(v.x()), 1}, Fraction{Wide(v.y()), 1}, Fraction{Wide(v.z()), 1}};
  };
  const auto half_space = [&](const Vector3& at, const Vector3& normal) {  // integers throughout
    return [o = exact(at), n = exact(normal)](const Point& x) {
      return (x[0] - o[0]) * n[0] + (x[1] - o[1]) * n[1] + (x[2] - o[2]) * n[2];
    };
  };
  std::vector<Point> polygon{exact(p[0]), exact(p[1]), exact(p[2])};
  const Vector3 n = (q[1] - q[0]).cross(q[2] - q[0]);
  polygon = clipped(polygon, half_space(q[0], n));
  polygon = clipped(polygon, half_space(q[0], -n));
  for (std::size_t k = 0; k < 3; ++k)
    polygon = clipped(polygon, half_space(q[k], n.cross(q[(k + 1) % 3] - q[k])));
  return polygon;
}

bool same(const Point& a, const Vector3& b) {
  for (std::size_t k = 0; k < 3; ++k)
    if (a[k].n != Wide(b[int(k)]) * a[k].d) return false;
  return true;
}

bool collinear_with(const Point& x, const Vector3& a, const Vector3& b) {
  const Vector3 along = b - a;
  Point d;
  for (std::size_t k = 0; k < 3; ++k) d[k] = x[k] - Fraction{Wide(a[int(k)]), 1};
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t l = (k + 1) % 3;
    const Fraction cross = d[k] * Fraction{Wide(along[int(l)]), 1} - d[l] * Fraction{Wide(along[int(k)]), 1};
    if (sign_of(cross) != 0) return false;
  }
  return true;
}

TEST(TriangleIntersection, AgreesWithExactClippingOnSmallGrids) {
  Random random(7);
  std::array<int, 4> met{}, total{};
  for (int i = 0; i < 60000; ++i) {
    // A 5×5×5 grid makes touching, coplanar and collinear configurations common.
    const int size = i % 3 + 1;
    std::array<Vector3, 3> p, q;
    for (auto* t : {&p, &q})
      for (Vector3& v : *t) v = grid_point(random, size);
    const auto shared = std::size_t(i % 4 == 3 ? 0 : i % 4);
    for (std::size_t k = 0; k < shared; ++k) q[k] = p[(k + std::size_t(i)) % 3];
    if (is_degenerate(p[0], p[1], p[2]) || is_degenerate(q[0], q[1], q[2])) continue;
    // Corners that coincide by chance are shared as well.
    Triangle p_ids{0, 1, 2}, q_ids{3, 4, 5};
    std::vector<Vector3> common;
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b)
        if (p[a] == q[b]) {
          q_ids[b] = p_ids[a];
          common.push_back(p[a]);
        }
    bool expected = false;
    for (const Point& x : common_part(p, q)) {
      if (common.size() == 0 || common.size() == 3) expected = true;
      if (common.size() == 1) expected = expected || !same(x, common[0]);
      if (common.size() == 2) expected = expected || !collinear_with(x, common[0], common[1]);
    }
    ASSERT_EQ(triangles_intersect(p, p_ids, q, q_ids), expected) << i << " shared " << common.size();
    ASSERT_EQ(triangles_intersect(q, q_ids, p, p_ids), expected);
    ++total[common.size()];
    met[common.size()] += expected;
  }
  for (std::size_t shared = 0; shared < 3; ++shared) {
    EXPECT_GT(met[shared], 100) << shared;
    EXPECT_GT(total[shared] - met[shared], 100) << shared;
  }
}

TEST(SelfIntersection, CleanShapesHaveNone) {
  EXPECT_TRUE(self_intersections(test::tetrahedron()).empty());
  EXPECT_TRUE(self_intersections(test::box({-1, -2, -3}, {4, 5, 6})).empty());
  EXPECT_TRUE(self_intersections(test::sphere(5, 20.0)).empty());
  EXPECT_TRUE(self_intersections(test::torus(20, 5, 60, 30)).empty());
  EXPECT_TRUE(self_intersections(test::spiky(4, 3)).empty());
  EXPECT_TRUE(self_intersections(TriangleMesh()).empty());
  // A flat sheet turned into a general plane: all coplanar to within rounding.
  TriangleMesh flat = test::sheet(60, 50.0, [](double x, double y) { return 0.1 * x - 0.3 * y; });
  EXPECT_TRUE(self_intersections(flat).empty());
}

TEST(SelfIntersection, KnownCasesAreFound) {
  // Two triangles that pierce each other.
  TriangleMesh m;
  m.vertices_mm = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {1, 1, -1}, {1, 1, 1}, {3, 3, 1}};
  m.triangles = {{0, 1, 2}, {3, 4, 5}};
  EXPECT_EQ(self_intersections(m), (Pairs{{0, 1}}));
  // Neighbours across an edge, folded flat onto each other; opened by a hair they are clean.
  m.vertices_mm = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {4, 4, 0}};
  m.triangles = {{0, 1, 2}, {1, 0, 3}};
  EXPECT_EQ(self_intersections(m), (Pairs{{0, 1}}));
  m.vertices_mm[3].z() = 1e-14;
  EXPECT_TRUE(self_intersections(m).empty());
  // One common vertex; the second runs through the first.
  m.vertices_mm = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {2, 2, 1}, {2, 2, -1}};
  m.triangles = {{0, 1, 2}, {0, 3, 4}};
  EXPECT_EQ(self_intersections(m), (Pairs{{0, 1}}));
  m.vertices_mm[4] = {2, 2, 0.5};
  EXPECT_TRUE(self_intersections(m).empty());
  // The same triangle twice, once through vertices of its own.
  m.vertices_mm = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {0, 0, 0}, {4, 0, 0}, {0, 4, 0}};
  m.triangles = {{0, 1, 2}, {3, 4, 5}};
  EXPECT_EQ(self_intersections(m), (Pairs{{0, 1}}));
  // A triangle without area is no surface.
  m.triangles = {{0, 1, 2}, {1, 1, 5}, {0, 4, 1}};
  EXPECT_TRUE(self_intersections(m).empty());
}

TEST(SelfIntersection, OverlappingSpheresCrossAlongTheirCircle) {
  const TriangleMesh a = test::sphere(5, 10.0);
  TriangleMesh b = a;
  for (Vector3& v : b.vertices_mm) v += Vector3(7.1, 0.3, 0.2);
  const Pairs crossing = intersections(a, b);
  ASSERT_GT(crossing.size(), 100u);
  const MeshQuery of_b(b);
  for (const auto& [i, j] : crossing) {
    bool near = false;
    for (int k = 0; k < 3; ++k) near = near || of_b.closest(a.corner(i, k))->distance_mm < 1.0;
    EXPECT_TRUE(near);
  }
  // The same as the self-intersections of both together, and every crossing triangle of a has corners on
  // both sides of b or is crossed by an edge of b.
  Pairs together = self_intersections(merged(a, b));
  const auto n = static_cast<std::uint32_t>(a.triangles.size());
  for (auto& pair : together) pair[1] -= n;
  EXPECT_EQ(together, crossing);
  for (std::uint32_t i = 0; i < n; ++i) {
    const bool in0 = of_b.signed_distance(a.corner(i, 0))->distance_mm < 0;
    const bool in1 = of_b.signed_distance(a.corner(i, 1))->distance_mm < 0;
    if (in0 == in1) continue;
    EXPECT_TRUE(std::any_of(crossing.begin(), crossing.end(), [&](const auto& p) { return p[0] == i; }));
  }
  // Apart, or one inside the other: nothing.
  for (Vector3& v : b.vertices_mm) v += Vector3(20, 0, 0);
  EXPECT_TRUE(intersections(a, b).empty());
  EXPECT_TRUE(intersections(a, test::sphere(4, 5.0)).empty());
}

TEST(SelfIntersection, AgreesWithAllPairsOnRandomSoup) {
  Random random(17);
  TriangleMesh soup;
  for (std::uint32_t i = 0; i < 600; ++i) {
    const Vector3 at = random.normal3() * 10.0;
    for (int k = 0; k < 3; ++k) soup.vertices_mm.push_back(at + random.normal3());
    soup.triangles.push_back({3 * i, 3 * i + 1, i % 3 == 0 && i > 0 ? 3 * i - 1 : 3 * i + 2});
  }
  Pairs expected;
  for (std::uint32_t i = 0; i < soup.triangles.size(); ++i)
    for (std::uint32_t j = i + 1; j < soup.triangles.size(); ++j)
      if (triangles_intersect({soup.corner(i, 0), soup.corner(i, 1), soup.corner(i, 2)}, soup.triangles[i],
                              {soup.corner(j, 0), soup.corner(j, 1), soup.corner(j, 2)}, soup.triangles[j]))
        expected.push_back({i, j});
  ASSERT_GT(expected.size(), 20u);
  EXPECT_EQ(self_intersections(soup), expected);
  const Pairs some = self_intersections(soup, 5);
  EXPECT_EQ(some.size(), 5u);
  EXPECT_TRUE(std::includes(expected.begin(), expected.end(), some.begin(), some.end()));
  EXPECT_TRUE(self_intersections(soup, 0).empty());
}

TEST(SelfIntersection, RealJawsInImpossiblePoseCross) {
  const auto data = test::shared_data();
  if (data.empty()) GTEST_SKIP() << "skipped: the shared data folder is not here";
  auto maxilla = read_jaw(data / "jaws/crowns/maxilla.stl"),
       mandible = read_jaw(data / "jaws/crowns/mandible_mi.stl");
  ASSERT_TRUE(maxilla && mandible);
  const auto down = transformed(Rigid3::from_translation({0, -2, 0}), *mandible);
  const auto up = transformed(Rigid3::from_translation({0, 1, 0}), *mandible);
  EXPECT_TRUE(intersections(*maxilla, down).empty());   // data/README: 04_down2 leaves a gap
  EXPECT_GT(intersections(*maxilla, up).size(), 500u);  // 90_impossible_up1: about 1 mm deep
}

}  // namespace
}  // namespace gnathion
