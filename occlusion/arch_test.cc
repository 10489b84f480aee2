#include "occlusion/arch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "core/mesh_io.h"
#include "core/random.h"
#include "occlusion/test_jaws.h"

namespace gnathion {
namespace {

constexpr double kDeg = 3.14159265358979323846 / 180.0;

double angle_deg(const Vector3& a, const Vector3& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) / kDeg;
}

Rigid3 random_motion(std::uint64_t seed) {
  Random random(seed);
  return {random.rotation(), 200.0 * random.normal3()};
}

std::filesystem::path shared() {
  const char* set = std::getenv("GNATHION_SHARED");
  return set ? std::filesystem::path(set) : std::filesystem::path("../shared");
}

TEST(FindArch, FindsPlaneMidlineAndCurveOfKnownArches) {
  const auto jaws = testing::simple_jaws();
  const auto frame = find_arch(jaws.maxilla, jaws.mandible);
  ASSERT_TRUE(frame) << frame.error().line();
  EXPECT_LT(angle_deg(frame->up, Vector3::UnitZ()), 0.5);
  EXPECT_LT(angle_deg(frame->anterior, -Vector3::UnitY()), 0.5);
  EXPECT_LT(angle_deg(frame->left, Vector3::UnitX()), 0.5);
  EXPECT_NEAR(frame->height_mm(Vector3::Zero()), 0.0, 0.2);
  EXPECT_NEAR(frame->incisal_mm.x(), 0.0, 0.3);
  EXPECT_NEAR(frame->incisal_mm.y(), 0.0, 1.0);
  // The curve follows y = x²/22 between the second molars.
  for (const auto& p : frame->curve_mm) {
    if (std::abs(p.x()) > 22.0) continue;
    const double slope = 2.0 * p.x() / 22.0;
    EXPECT_LT(std::abs(p.y() - p.x() * p.x() / 22.0) / std::hypot(1.0, slope), 1.2) << p.transpose();
  }
  EXPECT_LT(frame->to_arch(frame->curve_mm.front()).x(), -20.0) << "the curve starts at the patient's right";
  EXPECT_GT(frame->to_arch(frame->curve_mm.back()).x(), 20.0);
  EXPECT_LT((frame->arch_from_dental * frame->origin_mm).norm(), 1e-9);
}

TEST(FindArch, TurnsWithTheMeshes) {
  const auto jaws = testing::simple_jaws();
  const auto frame = find_arch(jaws.maxilla, jaws.mandible);
  ASSERT_TRUE(frame);
  for (std::uint64_t seed = 100; seed < 108; ++seed) {
    const Rigid3 x = random_motion(seed);
    const auto moved = find_arch(transformed(x, jaws.maxilla), transformed(x, jaws.mandible));
    ASSERT_TRUE(moved) << moved.error().line();
    EXPECT_LT(angle_deg(moved->up, x.rotation * frame->up), 1e-3);
    EXPECT_LT(angle_deg(moved->left, x.rotation * frame->left), 1e-3);
    EXPECT_LT((moved->origin_mm - x * frame->origin_mm).norm(), 1e-3);
    EXPECT_LT((moved->incisal_mm - x * frame->incisal_mm).norm(), 1e-3);
    ASSERT_EQ(moved->curve_mm.size(), frame->curve_mm.size());
  }
}

TEST(FindArch, RefusesByName) {
  const auto jaws = testing::simple_jaws();
  auto expect_refused = [](const TriangleMesh& a, const TriangleMesh& b, const std::string& word) {
    const auto frame = find_arch(a, b);
    ASSERT_FALSE(frame) << "accepted, expected: " << word;
    EXPECT_EQ(frame.error().code, ErrorCode::kInput);
    EXPECT_NE(frame.error().line().find(word), std::string::npos) << frame.error().line();
  };
  const Rigid3 away = Rigid3::from_translation({0.0, 0.0, -40.0});
  expect_refused(jaws.maxilla, transformed(away, jaws.mandible), "different frames");
  expect_refused(jaws.mandible, jaws.maxilla, "upper given as lower");
  TriangleMesh flipped_upper = jaws.maxilla, flipped_lower = jaws.mandible;
  flip_orientation(flipped_upper);
  flip_orientation(flipped_lower);
  expect_refused(flipped_upper, jaws.mandible, "flipped normals");
  expect_refused(jaws.maxilla, flipped_lower, "flipped normals");
  expect_refused(flipped_upper, flipped_lower, "flipped normals");

  auto left_half = [](const TriangleMesh& mesh) {
    std::vector<bool> keep;
    for (const Triangle& t : mesh.triangles) keep.push_back(mesh.vertices_mm[t[0]].x() > 8.0);
    return submesh(mesh, keep);
  };
  const auto quadrant = find_arch(left_half(jaws.maxilla), left_half(jaws.mandible));
  ASSERT_FALSE(quadrant);
  EXPECT_NE(quadrant.error().line().find("arch shape"), std::string::npos) << quadrant.error().line();
}

TEST(ArchRuler, MeasuresAlongACircle) {
  ArchFrame frame;  // x left, y posterior, z up
  for (int k = 0; k <= 180; ++k) {
    const double a = k * kDeg;
    frame.curve_mm.emplace_back(-25.0 * std::cos(a), -25.0 * std::sin(a), 0.0);
  }
  const ArchRuler ruler(frame);
  const double s = 25.0 * 40.0 * kDeg;  // 40° to the left of the front
  const Vector3 out(std::sin(40.0 * kDeg), -std::cos(40.0 * kDeg), 0.0);
  const auto at = ruler.measure(27.0 * out + Vector3(0, 0, 3.0));
  EXPECT_NEAR(at.s_mm, s, 0.05);
  EXPECT_NEAR(at.buccal_mm, 2.0, 0.01);
  EXPECT_NEAR(at.height_mm, 3.0, 1e-12);
  EXPECT_NEAR(ruler.measure(23.0 * out).buccal_mm, -2.0, 0.01);
  EXPECT_LT((ruler.at(s) - 25.0 * out).norm(), 0.05);
  EXPECT_LT((ruler.outward(s) - out).norm(), 0.02);
  // Past the left end the curve goes on straight back.
  const auto past = ruler.measure({25.0, 4.0, 0.0});
  EXPECT_NEAR(past.s_mm, 25.0 * 90.0 * kDeg + 4.0, 0.1);
  EXPECT_NEAR(past.buccal_mm, 0.0, 0.1);
}

// The data's description tells the axes of the real pairs; the occlusal plane of the cast is tilted a little.
TEST(FindArch, OrientsRealPairsInAnyPose) {
  struct Pair {
    const char* folder;
    Vector3 up, anterior;
  };
  const Pair pairs[] = {{"cast", Vector3::UnitZ(), -Vector3::UnitX()},
                        {"crowns", Vector3::UnitY(), Vector3::UnitZ()}};
  for (const Pair& pair : pairs) {
    const auto folder = shared() / "data/jaws" / pair.folder;
    if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no real jaws at " << folder;
    const auto maxilla = read_jaw(folder / "maxilla.stl"), mandible = read_jaw(folder / "mandible_mi.stl");
    ASSERT_TRUE(maxilla && mandible);
    for (std::uint64_t seed = 0; seed < 3; ++seed) {
      const Rigid3 x = seed == 0 ? Rigid3::identity() : random_motion(seed);
      const auto frame = find_arch(transformed(x, *maxilla), transformed(x, *mandible));
      ASSERT_TRUE(frame) << frame.error().line();
      EXPECT_LT(angle_deg(frame->up, x.rotation * pair.up), 8.0) << pair.folder;
      EXPECT_LT(angle_deg(frame->anterior, x.rotation * pair.anterior), 8.0) << pair.folder;
    }
    const auto exchanged = find_arch(*mandible, *maxilla);
    ASSERT_FALSE(exchanged) << pair.folder;
    EXPECT_NE(exchanged.error().line().find("upper given as lower"), std::string::npos);
  }
}

}  // namespace
}  // namespace gnathion
