#include "calibration/displacement.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

#include "core/angle.h"
#include "core/random.h"

namespace gnathion {
namespace {

Matrix6 covariance_at_teeth() {
  Random random(3);
  Matrix6 a;
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 6; ++c) a(r, c) = (r < 3 ? 4e-4 : 0.03) * random.normal();
  return a * a.transpose() / 6.0;
}

Uncertain<Motion<Dental>> opening() {
  const Rigid3 turn = Rigid3::about_axis({0, 88, 35}, {1, 0.05, -0.02}, 3.0 / kDegPerRad);
  return {Motion<Dental>(Rigid3::from_translation({0.6, 0.1, -0.2}) * turn), covariance_at_teeth()};
}

Rigid3 drawn(const Uncertain<Motion<Dental>>& motion, Random& random) {
  Vector6 z;
  for (int k = 0; k < 6; ++k) z[k] = random.normal();
  return exp_se3(motion.covariance.llt().matrixL() * z) * motion.value.rigid;
}

// Balls about points of very different covariances hold 95 % of drawn errors.
TEST(Displacement, RadiusHolds95PerCent) {
  Random random(17);
  for (const Vector3& sigma :
       {Vector3(1, 1, 1), Vector3(1, 0.01, 0.01), Vector3(1, 0.8, 0.1), Vector3(1, 0.5, 0.5)}) {
    const double radius = radius95_mm(sigma.cwiseAbs2().asDiagonal());
    int inside = 0;
    constexpr int kRuns = 40000;
    for (int run = 0; run < kRuns; ++run) inside += random.normal3().cwiseProduct(sigma).norm() <= radius;
    EXPECT_NEAR(inside / double(kRuns), 0.95, 0.006) << sigma.transpose();
  }
  EXPECT_EQ(radius95_mm(Matrix3::Zero()), 0.0);
}

TEST(Displacement, ErrorMapHolds95PerCentAtEachPoint) {
  const auto motion = opening();
  const std::vector<Vector3> points = {{0, 0, 0}, {25, 35, 2}, {-25, 35, 2}, {50, 90, 36}, {-50, 90, 36}};
  const std::vector<double> bounds = error_map95_mm(motion, points);
  std::vector<int> inside(points.size());
  Random random(23);
  constexpr int kRuns = 20000;
  for (int run = 0; run < kRuns; ++run) {
    const Rigid3 other = drawn(motion, random);
    for (std::size_t i = 0; i < points.size(); ++i)
      inside[i] += (other * points[i] - motion.value * points[i]).norm() <= bounds[i];
  }
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_NEAR(inside[i] / double(kRuns), 0.95, 0.008) << i;
}

TEST(Displacement, ScrewAxisIsTheMotion) {
  Random random(29);
  for (int run = 0; run < 50; ++run) {
    const Vector3 direction = random.unit_vector(), on_axis(0, 40, 20);
    const double angle = random.uniform(0.01, 3.0), shift = random.uniform(-3, 3);
    const Rigid3 motion =
        Rigid3::from_translation(shift * direction) * Rigid3::about_axis(on_axis, direction, angle);
    const Vector3 reference = 30 * random.normal3();
    const ScrewAxis s = screw_axis({Motion<Dental>(motion), 1e-12 * Matrix6::Identity()}, reference);
    EXPECT_NEAR(s.angle_deg, angle * kDegPerRad, 1e-6);
    EXPECT_NEAR(s.shift_mm, shift, 1e-6);
    EXPECT_LT((s.direction - direction).norm(), 1e-7);
    const Vector3 off = s.point_mm - on_axis;
    EXPECT_LT((off - off.dot(direction) * direction).norm(), 1e-5) << "a point of the axis";
    EXPECT_NEAR((s.point_mm - reference).dot(direction), 0.0, 1e-5) << "the one nearest to the reference";
    EXPECT_TRUE(s.determined);
  }
}

TEST(Displacement, ScrewSigmasAreThoseOfDrawnMotions) {
  const auto motion = opening();
  const Vector3 reference(0, 20, -5);
  const ScrewAxis stated = screw_axis(motion, reference);
  double angle = 0, shift = 0;
  Matrix3 direction = Matrix3::Zero(), point = Matrix3::Zero();
  Random random(31);
  constexpr int kRuns = 6000;
  for (int run = 0; run < kRuns; ++run) {
    const ScrewAxis s = screw_axis({Motion<Dental>(drawn(motion, random)), motion.covariance}, reference);
    angle += std::pow(s.angle_deg - stated.angle_deg, 2) / kRuns;
    shift += std::pow(s.shift_mm - stated.shift_mm, 2) / kRuns;
    const Vector3 d = s.direction - stated.direction;
    Vector3 p = s.point_mm - stated.point_mm;
    p -= p.dot(stated.direction) * stated.direction;
    direction += d * d.transpose() / kRuns;
    point += p * p.transpose() / kRuns;
  }
  EXPECT_NEAR(std::sqrt(angle), stated.angle_sigma_deg, 0.05 * stated.angle_sigma_deg);
  EXPECT_NEAR(std::sqrt(shift), stated.shift_sigma_mm, 0.05 * stated.shift_sigma_mm);
  const auto worst = [](const Matrix3& m) {
    return std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix3>(m, Eigen::EigenvaluesOnly).eigenvalues()[2]);
  };
  EXPECT_NEAR(worst(direction) * kDegPerRad, stated.direction_sigma_deg, 0.08 * stated.direction_sigma_deg);
  EXPECT_NEAR(worst(point), stated.point_sigma_mm, 0.08 * stated.point_sigma_mm);
}

TEST(Displacement, NoTurnHasNoAxis) {
  const ScrewAxis s = screw_axis(
      {Motion<Dental>(Rigid3::from_translation({0, 0, -2})), covariance_at_teeth()}, Vector3::Zero());
  EXPECT_FALSE(s.determined);
  EXPECT_NEAR(s.shift_mm, 2.0, 1e-9);
}

}  // namespace
}  // namespace gnathion
