#include "core/rigid.h"

#include <gtest/gtest.h>

#include <functional>

#include "core/random.h"

namespace gnathion {
namespace {

Rigid3 random_rigid(Random& random, double size_mm = 50) {
  return {random.rotation(), size_mm * random.normal3()};
}

TEST(Rigid, LogInvertsExpUpToPi) {
  Random random(11);
  for (int i = 0; i < 2000; ++i) {
    const double angle = i % 3 == 0   ? random.uniform(0, 1e-7)
                         : i % 3 == 1 ? random.uniform(0, 3.1)
                                      : M_PI - 1e-9;
    Vector6 xi;
    xi << random.unit_vector() * angle, 30 * random.normal3();
    const Rigid3 x = exp_se3(xi);
    EXPECT_LT((x.rotation.transpose() * x.rotation - Matrix3::Identity()).norm(), 1e-12);
    const Rigid3 back = exp_se3(log_se3(x));
    EXPECT_LT((back.matrix() - x.matrix()).norm(), 1e-6);
    if (i % 3 != 2) {
      EXPECT_LT((log_se3(x) - xi).norm(), 1e-7 * (1 + xi.norm()));
    }
  }
}

TEST(Rigid, ExpIsTheLimitOfSmallSteps) {
  // Independent of the closed form: (I + ξ^/n)^n.
  Vector6 xi;
  xi << 0.4, -0.7, 1.1, 3, -5, 8;
  Matrix4 generator = Matrix4::Zero();
  generator.topLeftCorner<3, 3>() = skew(xi.head<3>());
  generator.topRightCorner<3, 1>() = xi.tail<3>();
  Matrix4 step = Matrix4::Identity() + generator / 1048576.0;
  for (int i = 0; i < 20; ++i) step = (step * step).eval();
  EXPECT_LT((exp_se3(xi).matrix() - step).cwiseAbs().maxCoeff(), 1e-4);
}

TEST(Rigid, AdjointCarriesPerturbationsAcross) {
  Random random(12);
  for (int i = 0; i < 200; ++i) {
    const Rigid3 x = random_rigid(random);
    Vector6 xi;
    xi << 0.3 * random.normal3(), random.normal3();
    const Rigid3 left = x * exp_se3(xi) * x.inverse();
    EXPECT_LT((left.matrix() - exp_se3(adjoint(x) * xi).matrix()).norm(), 1e-9);
  }
}

Matrix6 sample_covariance(const std::function<Vector6()>& draw, int n) {
  Matrix6 sum = Matrix6::Zero();
  for (int i = 0; i < n; ++i) {
    const Vector6 xi = draw();
    sum += xi * xi.transpose();
  }
  return sum / n;
}

TEST(Rigid, CovariancesOfProductInverseAndPointMatchMonteCarlo) {
  Random random(13);
  const Rigid3 a = random_rigid(random), b = random_rigid(random);
  const auto noise = [&](double rad, double mm) {
    Vector6 xi;
    xi << rad * random.normal3(), mm * random.normal3();
    return xi;
  };
  Matrix6 cov_a = Matrix6::Zero(), cov_b = Matrix6::Zero();
  cov_a.diagonal() << 1e-6, 1e-6, 1e-6, 0.01, 0.01, 0.01;
  cov_b.diagonal() << 4e-6, 4e-6, 4e-6, 0.04, 0.04, 0.04;
  const int n = 20000;
  const Matrix6 product = sample_covariance(
      [&] { return difference((exp_se3(noise(1e-3, 0.1)) * a) * (exp_se3(noise(2e-3, 0.2)) * b), a * b); },
      n);
  const Matrix6 expected = composed_covariance(cov_a, a, cov_b);
  EXPECT_LT((product - expected).norm() / expected.norm(), 0.05);
  const Matrix6 inverse = sample_covariance(
      [&] { return difference((exp_se3(noise(1e-3, 0.1)) * a).inverse(), a.inverse()); }, n);
  const Matrix6 expected_inverse = inverse_covariance(cov_a, a);
  EXPECT_LT((inverse - expected_inverse).norm() / expected_inverse.norm(), 0.05);
  const Vector3 p(10, -40, 25);
  Matrix3 point = Matrix3::Zero();
  for (int i = 0; i < n; ++i) {
    const Vector3 d = (exp_se3(noise(1e-3, 0.1)) * a) * p - a * p;
    point += d * d.transpose() / n;
  }
  const Matrix3 expected_point = point_covariance(cov_a, a * p);
  EXPECT_LT((point - expected_point).norm() / expected_point.norm(), 0.05);
}

TEST(Rigid, DeviationNamesWhatIsNotRigid) {
  Matrix4 m = Rigid3::about_axis({1, 2, 3}, {0, 1, 1}, 0.5).matrix();
  EXPECT_TRUE(rigidity_deviation(m).is_rigid());
  m.topLeftCorner<3, 3>() *= 1.001;
  EXPECT_FALSE(rigidity_deviation(m).is_rigid());
  EXPECT_NEAR(rigidity_deviation(m).determinant, 1.003003001, 1e-9);
  m = Matrix4::Identity();
  m(0, 0) = -1;  // a mirror
  EXPECT_FALSE(rigidity_deviation(m).is_rigid());
  m = Matrix4::Identity();
  m(3, 0) = 0.1;
  EXPECT_FALSE(rigidity_deviation(m).is_rigid());
  m(3, 0) = std::nan("");
  EXPECT_FALSE(rigidity_deviation(m).is_rigid());
}

}  // namespace
}  // namespace gnathion
