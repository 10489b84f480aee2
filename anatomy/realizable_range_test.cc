#include "anatomy/realizable_range.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "anatomy/motion_envelope.h"
#include "core/mesh_test_shapes.h"
#include "core/random.h"
#include "occlusion/test_jaws.h"

namespace gnathion {
namespace {

constexpr double kDeg = 3.14159265358979323846 / 180.0;

TEST(JawCoordinates, AreOneToOneAndTellTheirDirections) {
  ArchFrame arch;  // left x, anterior −y, up z
  const Vector3 middle(0, 88, 35);
  JawCoordinates c;
  c[JawAxis::kOpening] = 5.0;
  EXPECT_LT((motion_of(c, arch, middle) * Vector3(0, 0, 0)).z(), -5.0) << "the chin goes down";
  c = {};
  c[JawAxis::kYaw] = 5.0;
  EXPECT_GT((motion_of(c, arch, middle) * Vector3(0, 0, 0)).x(), 5.0) << "the chin goes to the left";
  c = {};
  c[JawAxis::kRoll] = 5.0;
  EXPECT_LT((motion_of(c, arch, middle) * Vector3(52, 88, 35)).z(), 35.0 - 4.0) << "the left side goes down";
  c = {};
  c[JawAxis::kProtrusion] = 2.0, c[JawAxis::kLaterotrusion] = 1.0, c[JawAxis::kLowering] = 3.0;
  EXPECT_LT((motion_of(c, arch, middle).translation_mm - Vector3(1, -2, -3)).norm(), 1e-12);

  Random random(5);
  for (int i = 0; i < 50; ++i) {
    JawCoordinates in;
    for (double& v : in.value) v = random.uniform(-20, 20);
    const JawCoordinates out = coordinates_of(motion_of(in, arch, middle), arch, middle);
    for (std::size_t k = 0; k < in.value.size(); ++k) EXPECT_NEAR(out.value[k], in.value[k], 1e-9);
  }
  EXPECT_EQ(jaw_axis_of("yaw"), JawAxis::kYaw);
  EXPECT_FALSE(jaw_axis_of("sideways"));
}

class SimpleRange : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(checker) << checker.error().line();
    options.x = {JawAxis::kProtrusion, -3.0, 6.0, 4};
    options.y = {JawAxis::kLowering, -1.0, 2.0, 4};
  }
  testing::SimpleJaws jaws = testing::simple_jaws();
  Result<RealizabilityChecker> checker = RealizabilityChecker::create(jaws.maxilla, jaws.mandible);
  SilentProgress silent;
  RangeOptions options;
};

TEST_F(SimpleRange, EveryCellIsACheck) {
  const auto range = realizable_range(*checker, options, silent);
  ASSERT_TRUE(range) << range.error().line();
  ASSERT_EQ(range->cells.size(), 16u);
  EXPECT_FALSE(range->joints_checked);
  for (int iy = 0; iy < 4; ++iy)
    for (int ix = 0; ix < 4; ++ix) {
      const Rigid3 motion = range_motion(options, *checker, options.x.at(ix), options.y.at(iy));
      const Feasibility f = checker->check(Motion<Dental>(motion));
      EXPECT_EQ(range->at(ix, iy).violated, f.violated()) << ix << " " << iy;
      EXPECT_EQ(range->at(ix, iy).verdict >= RangeVerdict::kApertures, f.verdict != Verdict::kNotRealizable);
    }
  EXPECT_EQ(range->at(1, 0).verdict, RangeVerdict::kTeeth) << "1 mm up from MI";
  EXPECT_EQ(range->at(1, 1).verdict, RangeVerdict::kApertures) << "MI itself: no room for a wall";
  EXPECT_EQ(range->at(1, 3).verdict, RangeVerdict::kRealizable) << "2 mm down";
  EXPECT_EQ(range->at(0, 3).verdict, RangeVerdict::kMovement) << "3 mm back";
  EXPECT_NEAR(range->at(1, 3).clearance_mm, 2.02, 0.03);
}

TEST_F(SimpleRange, JointsForbidByName) {
  Joints joints;
  for (const Side side : {Side::kLeft, Side::kRight}) {
    Joint joint;
    joint.side = side;
    const Rigid3 to = Rigid3::from_translation(checker->condyle_mm(side));
    joint.condyle = transformed(to, test::sphere(4, 5.0));
    // A plate 2 mm above the condyle that slopes down in front: 45 degrees.
    joint.fossa.vertices_mm = {{-12, 12, 7}, {12, 12, 7},   {12, -3, 7},
                               {-12, -3, 7}, {12, -15, -5}, {-12, -15, -5}};
    joint.fossa.triangles = {{0, 2, 1}, {0, 3, 2}, {3, 4, 2}, {3, 5, 4}};
    flip_orientation(joint.fossa);
    joint.fossa = transformed(to, joint.fossa);
    if (face_normal_scaled(joint.fossa, 0).dot(checker->arch().up) > 0.0) flip_orientation(joint.fossa);
    joint.lateral_pole_mm = to * Vector3(5, 0, 0), joint.medial_pole_mm = to * Vector3(-5, 0, 0);
    (side == Side::kLeft ? joints.left : joints.right) = joint;
  }
  checker->use_joints(joints);
  options.x = {JawAxis::kProtrusion, 0.0, 9.0, 4};
  options.y = {JawAxis::kLowering, 2.0, 5.0, 4};
  const auto level = realizable_range(*checker, options, silent);
  ASSERT_TRUE(level) << level.error().line();
  EXPECT_TRUE(level->joints_checked);
  EXPECT_NE(level->at(0, 0).verdict, RangeVerdict::kJoints);
  EXPECT_NEAR(*level->at(0, 0).joint_mm, 12.0 / std::sqrt(2.0) - 5.0, 0.02) << "from the slope";
  EXPECT_EQ(level->at(3, 0).verdict, RangeVerdict::kJoints) << "9 mm forward, 2 down";
  EXPECT_NE(level->at(2, 3).verdict, RangeVerdict::kJoints) << "6 mm forward, 5 down";
  options.condylar_slope_deg = 45.0;
  const auto sloped = realizable_range(*checker, options, silent);
  ASSERT_TRUE(sloped);
  EXPECT_NE(sloped->at(2, 0).verdict, RangeVerdict::kJoints) << "down the slope";
}

TEST_F(SimpleRange, CanBeCancelledAndRefusesWhatIsNoMap) {
  std::atomic<bool> cancel = true;
  const auto stopped = realizable_range(*checker, options, silent, &cancel);
  ASSERT_FALSE(stopped);
  EXPECT_NE(stopped.error().line().find("cancelled"), std::string::npos);
  RangeOptions same = options;
  same.y.axis = same.x.axis;
  EXPECT_FALSE(realizable_range(*checker, same, silent));
  RangeOptions empty = options;
  empty.x.high = empty.x.low;
  EXPECT_FALSE(realizable_range(*checker, empty, silent));
  RangeOptions one = options;
  one.x.cells = 1;
  EXPECT_FALSE(realizable_range(*checker, one, silent));
}

/// Hinge opening to 20° and 6 mm of protrusion, as a recording would have them.
std::vector<Rigid3> recorded() {
  std::vector<Rigid3> out;
  for (int i = 0; i <= 100; ++i)
    out.push_back(Rigid3::about_axis({0, 88, 35}, Vector3::UnitX(), 0.2 * i * kDeg));
  for (int i = 0; i <= 60; ++i) out.push_back(Rigid3::from_translation({0, -0.1 * i, -0.05 * i}));
  return out;
}

TEST(MotionEnvelope, InsideBetweenAndOutside) {
  ArchFrame arch;
  arch.curve_mm = {{-25, 30, 0}, {0, 0, 0}, {25, 30, 0}};
  const MotionEnvelope envelope(recorded(), arch, {52, 88, 35}, {-52, 88, 35});
  EXPECT_GT(envelope.reach_mm(), 25.0);
  EXPECT_GT(envelope.positions(), 50u);
  EXPECT_EQ(envelope.distance({}).outside_mm, 0.0) << "MI";
  EXPECT_LT(envelope.distance(recorded()[40]).outside_mm, 0.16) << "a recorded position";
  EXPECT_LT(envelope.distance(recorded()[40]).nearest_mm, 0.16);
  // Half open and half forward: between what was recorded.
  const Rigid3 between = Rigid3::from_translation({0, -2.0, -1.0}) * recorded()[20];
  EXPECT_LT(envelope.distance(between).outside_mm, 0.3);
  EXPECT_GT(envelope.distance(between).nearest_mm, 1.0);
  // Straight back, and to the side: nothing was recorded there.
  const EnvelopeDistance back = envelope.distance(Rigid3::from_translation({0, 2.0, 0}));
  EXPECT_NEAR(back.outside_mm, 2.0, 0.35);
  const EnvelopeDistance side = envelope.distance(Rigid3::from_translation({3.0, -2.0, -1.0}));
  EXPECT_NEAR(side.outside_mm, 3.0, 0.1);
  EXPECT_FALSE(side.landmark.empty());
}

}  // namespace
}  // namespace gnathion
