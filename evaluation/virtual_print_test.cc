#include "evaluation/virtual_print.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh_query.h"
#include "evaluation/virtual_print_models.h"
#include "occlusion/test_jaws.h"

namespace gnathion {
namespace {

TriangleMesh ball(double radius_mm, int n = 60) {
  TriangleMesh m;
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i < 2 * n; ++i) {
      const double u = M_PI * i / n, v = M_PI * j / n;
      m.vertices_mm.push_back(radius_mm *
                              Vector3(std::sin(v) * std::cos(u), std::sin(v) * std::sin(u), std::cos(v)));
    }
  const auto id = [&](int i, int j) { return static_cast<std::uint32_t>(2 * n * j + i % (2 * n)); };
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < 2 * n; ++i) {
      if (j > 0) m.triangles.push_back({id(i, j), id(i, j + 1), id(i + 1, j)});
      if (j + 1 < n) m.triangles.push_back({id(i + 1, j), id(i, j + 1), id(i + 1, j + 1)});
    }
  return m;
}

const testing::SimpleJaws& jaws() {
  static const testing::SimpleJaws j = testing::simple_jaws();
  return j;
}
const ArchFrame& arch() {
  static const ArchFrame f = *find_arch(jaws().maxilla, jaws().mandible);
  return f;
}

/// All faults off.
PrintErrorModel perfect_print() {
  return {0, 0, 0, 0, 0, 0, 0, 8};
}
ScanErrorModel perfect_scan() {
  return {0, 0, 12, 0, 0};
}

TEST(VirtualPrint, BestMotionFindsAMotionAmongMarkedPoints) {
  Random random(3);
  const Rigid3 truth{random.rotation(), 20 * random.normal3()};
  std::vector<Vector3> from, to;
  std::vector<std::uint8_t> use;
  for (int i = 0; i < 40; ++i) {
    from.push_back(10 * random.normal3());
    use.push_back(i % 2 ? 1 : 0);
    to.push_back(truth * from.back() + (i % 2 ? Vector3::Zero() : Vector3(100 * random.normal3())));
  }
  const Rigid3 found = best_motion(from, to, use);
  EXPECT_LT((truth.inverse() * found).angle_rad(), 1e-9);
  EXPECT_LT((found.translation_mm - truth.translation_mm).norm(), 1e-9);
}

TEST(VirtualPrint, BlurShrinksABallByItsCurvature) {
  // κ1 + κ2 = 2/R: the surface moves in by r²/R.
  for (const double radius : {2.0, 4.0}) {
    const TriangleMesh before = ball(radius), after = blurred(before, 0.1);
    double sum = 0, n = 0;
    for (std::size_t v = 0; v < after.vertices_mm.size(); ++v) {
      if (std::abs(before.vertices_mm[v].z()) > 0.8 * radius) continue;  // slivers at the poles
      sum += before.vertices_mm[v].norm() - after.vertices_mm[v].norm();
      ++n;
    }
    EXPECT_NEAR(sum / n, 0.01 / radius, 0.2 * 0.01 / radius) << "ball of " << radius << " mm";
  }
}

TEST(VirtualPrint, PerfectPrinterAndScannerChangeNothing) {
  Random random(1);
  const TriangleMesh print = print_virtually(jaws().maxilla, arch(), perfect_print(), random);
  const TriangleMesh scan = scan_virtually(print, arch(), perfect_scan(), random);
  for (std::size_t v = 0; v < scan.vertices_mm.size(); ++v)
    ASSERT_LT((scan.vertices_mm[v] - jaws().maxilla.vertices_mm[v]).norm(), 1e-9);
}

TEST(VirtualPrint, EachFaultHasItsMagnitude) {
  const TriangleMesh& design = jaws().maxilla;
  const std::vector<Vector3> normals = vertex_normals(design);
  const auto n = static_cast<double>(normals.size());
  // Roughness: standard deviation along the normals, nothing across them.
  PrintErrorModel rough = perfect_print();
  rough.roughness_mm = 0.05;
  Random random(11);
  const TriangleMesh print = print_virtually(design, arch(), rough, random);
  double squares = 0, across = 0;
  for (std::size_t v = 0; v < normals.size(); ++v) {
    const Vector3 d = print.vertices_mm[v] - design.vertices_mm[v];
    squares += std::pow(d.dot(normals[v]), 2);
    across = std::max(across, (d - d.dot(normals[v]) * normals[v]).norm());
  }
  EXPECT_NEAR(std::sqrt(squares / n), 0.05, 0.05 * 4 / std::sqrt(2 * n));
  EXPECT_LT(across, 1e-9);

  // Scale, growth and warp over many prints: their stated standard deviations.
  const Vector3 left = arch().left, back = -arch().anterior;
  std::size_t a = 0, b = 0;  // the vertices farthest apart across the arch
  for (std::size_t v = 0; v < normals.size(); ++v) {
    if (design.vertices_mm[v].dot(left) < design.vertices_mm[a].dot(left)) a = v;
    if (design.vertices_mm[v].dot(left) > design.vertices_mm[b].dot(left)) b = v;
  }
  const double width = (design.vertices_mm[b] - design.vertices_mm[a]).dot(left);
  PrintErrorModel scaled = perfect_print(), grown = perfect_print(), warped = perfect_print();
  scaled.scale_sigma = 0.003;
  grown.growth_sigma_mm = 0.04;
  warped.warp_sigma_mm = 0.1;
  double scale2 = 0, growth2 = 0, lift2 = 0;
  constexpr int kDraws = 200;
  std::size_t end = 0;  // the hindmost vertex in the middle of a limb's height
  for (std::size_t v = 0; v < normals.size(); ++v)
    if (design.vertices_mm[v].dot(back) > design.vertices_mm[end].dot(back)) end = v;
  for (int i = 0; i < kDraws; ++i) {
    Random draw(20, static_cast<std::uint64_t>(i));
    const auto p = print_virtually(design, arch(), scaled, draw).vertices_mm;
    scale2 += std::pow((p[b] - p[a]).dot(left) / width - 1, 2);
    const auto g = print_virtually(design, arch(), grown, draw).vertices_mm;
    growth2 += std::pow((g[a] - design.vertices_mm[a]).dot(normals[a]), 2);
    const auto w = print_virtually(design, arch(), warped, draw).vertices_mm;
    lift2 += std::pow((w[end] - design.vertices_mm[end]).dot(arch().up), 2);
  }
  const double spread = 4 / std::sqrt(2.0 * kDraws);
  EXPECT_NEAR(std::sqrt(scale2 / kDraws), 0.003, 0.003 * spread);
  EXPECT_NEAR(std::sqrt(growth2 / kDraws), 0.04, 0.04 * spread);
  // Lift and twist add at an end: between one and √2 times the magnitude.
  EXPECT_GT(std::sqrt(lift2 / kDraws), 0.1 * (1 - spread));
  EXPECT_LT(std::sqrt(lift2 / kDraws), 0.1 * std::sqrt(2.0) * (1 + spread));
}

TEST(VirtualPrint, DrawnMotionTurnsAboutTheArch) {
  Random random(5);
  double shift2 = 0, turn2 = 0;
  constexpr int kDraws = 2000;
  for (int i = 0; i < kDraws; ++i) {
    const Rigid3 m = drawn_motion(arch(), {0.1, 0.1, 0.05}, 0.2, random);
    const Vector3 shift = m * arch().origin_mm - arch().origin_mm;
    EXPECT_LE(shift.dot(arch().up), 1e-9) << "the splint was pushed into the teeth";
    shift2 += shift.squaredNorm();
    turn2 += std::pow(m.angle_rad() * 180 / M_PI, 2);
  }
  EXPECT_NEAR(std::sqrt(shift2 / kDraws), std::sqrt(0.0225), 0.01);
  EXPECT_NEAR(std::sqrt(turn2 / kDraws), 0.2 * std::sqrt(3.0), 0.02);
}

TEST(VirtualPrint, MagnitudesAreSetByNameAndChecked) {
  VirtualPrintOptions o;
  EXPECT_TRUE(set_magnitude(o, "print.blur_mm=0.2"));
  EXPECT_EQ(o.print.blur_mm, 0.2);
  for (const char* wrong :
       {"print.blur_mm", "print.blur_mm=", "print.blur_mm=much", "blur=1", "print.blur_mm=nan"}) {
    const Status s = set_magnitude(o, wrong);
    ASSERT_FALSE(s) << wrong;
    EXPECT_EQ(s.error().code, ErrorCode::kUsage);
  }
  EXPECT_TRUE(check_options(o));
  ASSERT_TRUE(set_magnitude(o, "seating.shift_sigma_mm=-1"));
  EXPECT_FALSE(check_options(o));
  o = {};
  o.trials = 0;
  EXPECT_FALSE(check_options(o));
}

}  // namespace
}  // namespace gnathion
