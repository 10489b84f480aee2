// Discrepancy and registration object: known motions found again, errors as large as they say.
#include "evaluation/discrepancy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "core/random.h"
#include "evaluation/registration_object.h"

namespace gnathion {
namespace {

using ::testing::HasSubstr;

ArchFrame upright() {
  ArchFrame a;
  a.origin_mm = {0, 25, 0};
  return a;
}

Matrix6 covariance_about(const Vector3& p, double turn_rad, double shift_mm) {
  Matrix6 c = Matrix6::Zero();
  c.diagonal() << Vector3::Constant(turn_rad * turn_rad), Vector3::Constant(shift_mm * shift_mm);
  const Matrix6 to = adjoint(Rigid3::from_translation(p));
  return to * c * to.transpose();
}

Vector6 drawn(const Vector3& about, double turn_rad, double shift_mm, Random& random) {
  Vector6 x;
  x << turn_rad * random.normal3(), shift_mm * random.normal3();
  return adjoint(Rigid3::from_translation(about)) * x;
}

TEST(Discrepancy, AKnownShiftIsFoundWithTrueBounds) {
  Random random(1234);
  const ArchFrame arch = upright();
  const Vector3 hinge(0, 95, 35);
  const Rigid3 truth = Rigid3::from_translation({0.2, 0.6, -0.1}) *
                       Rigid3::about_axis(hinge, Vector3::UnitX(), 0.8 * M_PI / 180.0);
  const std::vector<Landmark> landmarks = {{"incisal", {0, 2, -1}}, {"condyle_left", {50, 95, 35}}};
  int incisal_inside = 0, condyle_inside = 0, false_alarms = 0;
  constexpr int kTrials = 400;
  for (int i = 0; i < kTrials; ++i) {
    const auto recording = [&](const Rigid3& at) {
      return MandiblePose{Motion<Dental>(exp_se3(drawn(arch.origin_mm, 0.002, 0.05, random)) * at),
                          covariance_about(arch.origin_mm, 0.002, 0.05)};
    };
    const auto d =
        find_discrepancy({recording(Rigid3::identity())}, {recording(truth)}, landmarks, arch).value();
    const auto inside = [&](std::size_t k) {
      const Vector3 true_shift = truth * landmarks[k].at_mm - landmarks[k].at_mm;
      return (d.landmarks[k].displacement_mm - true_shift).norm() <= d.landmarks[k].bound95_mm;
    };
    incisal_inside += inside(0);
    condyle_inside += inside(1);
    EXPECT_LT(d.p_value, 1e-6);
    EXPECT_NEAR(d.alpha_deg, 0.8, 0.6);
    // Two recordings of one position are no discrepancy, but for 5 %.
    false_alarms +=
        find_discrepancy({recording(truth)}, {recording(truth)}, landmarks, arch).value().p_value < 0.05;
  }
  // The bound is a ball about the ellipsoid: at least 95 % (less three standard errors) must be in it.
  EXPECT_GE(incisal_inside, 0.917 * kTrials);
  EXPECT_GE(condyle_inside, 0.917 * kTrials);
  EXPECT_GT(false_alarms, 0.015 * kTrials);
  EXPECT_LT(false_alarms, 0.085 * kTrials);
}

TEST(Discrepancy, RepeatedRecordingsThatScatterSaySo) {
  Random random(5);
  const ArchFrame arch = upright();
  std::vector<MandiblePose> cr;
  for (int i = 0; i < 6; ++i)
    cr.push_back({Motion<Dental>(exp_se3(drawn(arch.origin_mm, 0.01, 0.3, random))),
                  covariance_about(arch.origin_mm, 1e-4, 0.005)});  // far too sure of themselves
  const RepeatedPose mean = mean_pose(cr, arch.origin_mm);
  EXPECT_NEAR(mean.scatter_mm, 0.3 * std::sqrt(3.0), 0.3);
  EXPECT_GT(std::sqrt(point_covariance(mean.mean.covariance, arch.origin_mm).trace()), 0.1);
  EXPECT_THAT(find_discrepancy({}, cr, {}, arch).error().line(), HasSubstr("no recording"));
  cr[0].covariance(0, 0) = -1.0;
  EXPECT_THAT(find_discrepancy(cr, cr, {}, arch).error().line(), HasSubstr("covariance"));
}

struct Instruments {
  Rigid3 a_from_b, a_object_from_b_object;
  std::vector<ObjectPosition> positions;
};

Instruments seen(std::size_t count, bool common, bool one_axis, double turn_rad, double shift_mm,
                 Random& random) {
  Instruments s;
  s.a_from_b = {random.rotation(), 200.0 * random.normal3()};
  if (!common) s.a_object_from_b_object = {random.rotation(), 20.0 * random.normal3()};
  const Rigid3 start{random.rotation(), 100.0 * random.normal3()};
  const Vector3 axis = random.unit_vector();
  for (std::size_t i = 0; i < count; ++i) {
    const Rigid3 moved =
        Rigid3::about_axis({0, 90, 30}, one_axis ? axis : random.unit_vector(), 0.15 * i) * start;
    const Rigid3 a = moved, b = s.a_from_b.inverse() * moved * s.a_object_from_b_object;
    const auto blurred = [&](const Rigid3& x) {
      return Uncertain<Rigid3>{exp_se3(drawn(x.translation_mm, turn_rad, shift_mm, random)) * x,
                               covariance_about(x.translation_mm, turn_rad, shift_mm)};
    };
    s.positions.push_back({std::to_string(i), blurred(a), blurred(b)});
  }
  return s;
}

TEST(RegistrationObject, StartAndEndGiveTheTransformBetweenTheFrames) {
  Random random(66);
  double mahalanobis = 0.0, chi2 = 0.0;
  constexpr int kTrials = 200;
  for (int i = 0; i < kTrials; ++i) {
    const Instruments s = seen(2, true, false, 0.001, 0.03, random);
    const InstrumentLink link = link_instruments(s.positions, {}).value();
    const Vector6 error = difference(link.a_from_b.value, s.a_from_b);
    mahalanobis += error.dot(link.a_from_b.covariance.ldlt().solve(error)) / kTrials;
    chi2 += link.chi2 / kTrials;
    EXPECT_EQ(link.degrees_of_freedom, 6);
    EXPECT_TRUE(link.weak.empty()) << link.weak.front();
    const Vector6 closes = difference(link.motion_in_a, link.motion_in_a_by_b);
    EXPECT_LT(closes.head<3>().norm(), 0.02);
  }
  EXPECT_NEAR(mahalanobis, 6.0, 0.8);  // as large as the covariance says, no more and no less
  EXPECT_NEAR(chi2, 6.0, 0.8);
}

TEST(RegistrationObject, OwnFramesOnTheObjectNeedTurnsAboutTwoAxes) {
  Random random(67);
  double mahalanobis = 0.0;
  constexpr int kTrials = 100;
  for (int i = 0; i < kTrials; ++i) {
    const Instruments s = seen(6, false, false, 0.0005, 0.02, random);
    const auto link = link_instruments(s.positions, {false});
    ASSERT_TRUE(link.has_value()) << link.error().line();
    const Vector6 error = difference(link->a_from_b.value, s.a_from_b);
    mahalanobis += error.dot(link->a_from_b.covariance.ldlt().solve(error)) / kTrials;
    EXPECT_GT(link->condition, 1.0);
  }
  EXPECT_NEAR(mahalanobis, 6.0, 1.4);
  const auto one_axis = link_instruments(seen(6, false, true, 0.0, 0.0, random).positions, {false});
  ASSERT_FALSE(one_axis.has_value());
  EXPECT_THAT(one_axis.error().line(), HasSubstr("one axis"));
  const auto two = link_instruments(seen(2, false, false, 0.0, 0.0, random).positions, {false});
  EXPECT_THAT(two.error().line(), HasSubstr("3 are needed"));
}

TEST(RegistrationObject, AnExactPairIsMetExactly) {
  Random random(68);
  const Instruments s = seen(4, false, false, 0.0, 0.0, random);
  const InstrumentLink link = link_instruments(s.positions, {false}).value();
  EXPECT_LT((link.a_from_b.value.matrix() - s.a_from_b.matrix()).norm(), 1e-6);
  EXPECT_LT((link.object_a_from_object_b.value.matrix() - s.a_object_from_b_object.matrix()).norm(), 1e-6);
  EXPECT_LT(link.rms_mm, 1e-6);
}

}  // namespace
}  // namespace gnathion
