#include "registration/residual_noise.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "core/random.h"
#include "registration/point_grid.h"

namespace gnathion {
namespace {

/// Points on a sphere of 25 mm with residuals of known noise, by waves with Gaussian spectrum.
std::vector<PlanePair> noisy_sphere(double white_mm, double correlated_mm, double length_mm,
                                    std::uint64_t seed) {
  Random random(seed);
  constexpr int kWaves = 400;
  std::vector<Vector3> waves;
  std::vector<double> phases;
  for (int i = 0; i < kWaves; ++i) {
    waves.push_back(random.normal3() / length_mm);
    phases.push_back(random.uniform(0.0, 6.283185307179586));
  }
  std::vector<PlanePair> pairs;
  for (int i = 0; i < 3000; ++i) {
    const Vector3 n = random.unit_vector();
    // An ellipsoid's normals, so that rotations are determined.
    const Vector3 p = 25.0 * Vector3(n.x(), 1.4 * n.y(), 0.7 * n.z());
    const Vector3 normal = Vector3(n.x(), n.y() / 1.4, n.z() / 0.7).normalized();
    double field = 0.0;
    for (int k = 0; k < kWaves; ++k) field += std::cos(waves[k].dot(p) + phases[k]);
    const double r = white_mm * random.normal() + correlated_mm * std::sqrt(2.0 / kWaves) * field;
    pairs.push_back({p + r * normal, p, normal, static_cast<std::uint32_t>(i), 1.0});
  }
  return pairs;
}

TEST(ResidualNoise, TellsWhiteFromCorrelated) {
  double white = 0.0, correlated = 0.0, length = 0.0;
  constexpr int kRuns = 6;
  for (int run = 0; run < kRuns; ++run) {
    const auto noise = estimate_noise(noisy_sphere(0.03, 0.04, 8.0, 40 + run), {});
    white += noise.white_sigma_mm() / kRuns;
    correlated += noise.correlated_sigma_mm() / kRuns;
    length += noise.length_mm() / kRuns;
  }
  EXPECT_NEAR(white, 0.03, 0.006);
  EXPECT_NEAR(correlated, 0.04, 0.012);
  EXPECT_NEAR(length, 8.0, 2.5);
}

// The covariance of a linear fit under this noise, against 200 fits of it.
TEST(ResidualNoise, ScoreCovarianceMatchesRepeatedFits) {
  constexpr int kRuns = 200;
  Matrix6 sample = Matrix6::Zero(), stated = Matrix6::Zero();
  for (int run = 0; run < kRuns; ++run) {
    const std::vector<PlanePair> pairs = noisy_sphere(0.02, 0.03, 9.0, 1000 + run);
    const Matrix6 bread = information(pairs, {}).inverse();
    Vector6 score = Vector6::Zero();
    for (const PlanePair& p : pairs) score += p.jacobian({}) * p.residual_mm({});
    const Vector6 xi = -bread * score;
    sample += xi * xi.transpose() / kRuns;
    if (run == 0) {
      ResidualNoise known;
      known.models.push_back({1.0, 0.02, 0.03, 9.0, false});
      stated = bread * score_covariance(pairs, Rigid3::identity(), known) * bread;
    }
  }
  // 200 runs: each variance is known to 10 % (1σ).
  for (int k = 0; k < 6; ++k) EXPECT_NEAR(sample(k, k) / stated(k, k), 1.0, 0.35) << "direction " << k;
}

TEST(ResidualNoise, NamesTheWeakDirection) {
  // A cylinder with a slight taper: the rotation about its axis is all but free.
  Random random(9);
  std::vector<PlanePair> pairs;
  for (int i = 0; i < 2000; ++i) {
    const double angle = random.uniform(0.0, 6.283185307179586), z = random.uniform(-30.0, 30.0);
    const Vector3 n(std::cos(angle), std::sin(angle), 0.02 * std::sin(z));
    const Vector3 p(10.0 * n.x() * (1.0 + 0.002 * std::cos(3 * angle)), 10.0 * n.y(), z);
    pairs.push_back({p, p, n.normalized(), static_cast<std::uint32_t>(i), 1.0});
  }
  const Matrix6 covariance = 0.03 * 0.03 * information(pairs, {}).inverse();
  const Conditioning c = conditioning(pairs, {}, covariance);
  EXPECT_GT(c.condition, 100.0);
  ASSERT_FALSE(c.weak.empty());
  bool about_axis = false;
  for (const std::string& w : c.weak)
    about_axis |= w.find("rotation about axis") == 0 && w.find("1.00)") != std::string::npos;
  EXPECT_TRUE(about_axis) << c.weak.front();
}

TEST(PointGrid, FindsWhatBruteForceFinds) {
  Random random(4);
  std::vector<Vector3> points;
  for (int i = 0; i < 500; ++i) points.push_back(20.0 * random.normal3());
  const PointGrid grid(points, 4.0);
  for (int i = 0; i < 300; ++i) {
    const Vector3 p = 25.0 * random.normal3();
    const double radius = random.uniform(0.5, 15.0);
    std::size_t expected = 0, found = 0;
    long nearest = -1;
    for (std::size_t k = 0; k < points.size(); ++k) {
      const double d = (points[k] - p).norm();
      if (d > radius) continue;
      ++expected;
      if (nearest < 0 || d < (points[static_cast<std::size_t>(nearest)] - p).norm())
        nearest = static_cast<long>(k);
    }
    grid.for_each_within(p, radius, [&](std::uint32_t, double) { ++found; });
    EXPECT_EQ(found, expected);
    EXPECT_EQ(grid.nearest(p, radius), nearest);
  }
}

}  // namespace
}  // namespace gnathion
