#include "anatomy/joint_space.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh_test_shapes.h"
#include "core/random.h"

namespace gnathion {
namespace {

constexpr double kHead = 5.0, kSocket = 7.0;

/// Part of a sphere above a height, facing inwards: a socket over the head.
TriangleMesh socket_of(double radius, double from_height) {
  const TriangleMesh whole = test::sphere(5, radius);
  std::vector<bool> keep(whole.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) {
    keep[t] = true;
    for (int k = 0; k < 3; ++k) keep[t] = keep[t] && whole.corner(t, k).z() > from_height;
  }
  TriangleMesh socket = submesh(whole, keep);
  flip_orientation(socket);
  return socket;
}

Joint ball_and_socket() {
  Joint joint;
  joint.condyle = test::sphere(5, kHead);
  joint.fossa = socket_of(kSocket, 1.0);
  joint.medial_pole_mm = {-kHead, 0, 0};
  joint.lateral_pole_mm = {kHead, 0, 0};
  return joint;
}

class BallAndSocket : public ::testing::Test {
 protected:
  JointQuery query{ball_and_socket(), Vector3::UnitZ()};
  static Rigid3 up(double mm) { return Rigid3::from_translation({0, 0, mm}); }
};

TEST_F(BallAndSocket, DistanceIsThatOfTheSurfaces) {
  EXPECT_NEAR(query.in_mi().min_mm, kSocket - kHead, 0.02);
  for (const double mm : {-3.0, -1.0, 0.5, 1.5}) {
    const JointSpace s = query.at(up(mm));
    // Downwards the rim stays nearest; the cap's rim is at height 1.
    const double rim = std::sqrt(kSocket * kSocket - 1.0);
    const double expected = mm > 0 ? kSocket - kHead - mm : std::hypot(rim, 1.0 - mm) - kHead;
    EXPECT_NEAR(s.min_mm, expected, 0.06) << mm;
    EXPECT_NEAR((s.condyle_mm - s.fossa_mm).norm(), s.min_mm, 1e-9);
  }
  EXPECT_NEAR(query.at(Rigid3::from_translation({0.6, 0.8, 0.0}) * up(1.0)).min_mm,
              kSocket - kHead - std::sqrt(2.0), 0.02);
}

TEST_F(BallAndSocket, PenetrationIsNegativeAndItsGradientPointsOut) {
  const JointSpace s = query.at(up(3.2));
  EXPECT_NEAR(s.min_mm, -1.2, 0.03);
  EXPECT_LT(s.normal.z(), -0.95) << "down is out";
  EXPECT_NEAR(s.condyle_mm.z(), kHead + 3.2, 0.1);
  const double step = 0.05;
  EXPECT_NEAR(query.at(Rigid3::from_translation(step * s.normal) * up(3.2)).min_mm - s.min_mm, step, 0.01);
  EXPECT_LT(query.at(up(25.0)).min_mm, -5.0) << "gone through the roof";
}

TEST_F(BallAndSocket, TheAnswerDoesNotFeelTheFrame) {
  Random random(3);
  const Rigid3 x{random.rotation(), 80.0 * random.normal3()};
  Joint joint = ball_and_socket();
  joint.condyle = transformed(x, joint.condyle);
  joint.fossa = transformed(x, joint.fossa);
  const JointQuery turned(joint, x.rotation * Vector3::UnitZ());
  for (const double mm : {-2.0, 1.0, 2.6})
    EXPECT_NEAR(turned.at(x * up(mm) * x.inverse()).min_mm, query.at(up(mm)).min_mm, 1e-6) << mm;
}

TEST_F(BallAndSocket, TheMapTellsEveryVertexUnderTheSocket) {
  const auto map = query.map_mm(up(1.0));
  ASSERT_EQ(map.size(), query.joint().condyle.vertices_mm.size());
  std::size_t told = 0;
  for (std::size_t i = 0; i < map.size(); ++i) {
    const Vector3& v = query.joint().condyle.vertices_mm[i];
    if (std::isnan(map[i])) continue;
    ++told;
    EXPECT_NEAR(map[i], kSocket - (v + Vector3::UnitZ()).norm(), 0.03);
  }
  EXPECT_GT(told, map.size() / 4);
  EXPECT_LT(told, map.size()) << "nothing is over the lower half";
}

TEST(JointVariance, SumsWhatIsKnown) {
  JointSpace space;
  space.normal = Vector3::UnitZ();
  Joints joints;
  EXPECT_FALSE(joint_variance_mm2(joints, space, std::nullopt));
  Matrix6 covariance = Matrix6::Zero();
  covariance(5, 5) = 0.04;
  EXPECT_NEAR(*joint_variance_mm2(joints, space, covariance), 0.04, 1e-12);
  joints.surface_sigma_mm = 0.1;
  joints.fossa_covariance = covariance;
  EXPECT_NEAR(*joint_variance_mm2(joints, space, covariance), 0.04 + 0.04 + 0.02, 1e-12);
}

}  // namespace
}  // namespace gnathion
