// Generalised least squares on known noise: better than ordinary ones, as good as it says, and silent no
// longer where the noise is not what it is taken for.
#include "registration/patch_fit.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "core/random.h"
#include "registration/shared_shape.h"

namespace gnathion {
namespace {

/// Six plates of 30 mm about a bow of 150 mm, as a scanner sees them: white noise and a smooth field along
/// the normals; `bent` bends one edge of each plate inwards by that much, which no stationary noise does.
std::vector<PlanePair> plates(double white_mm, double correlated_mm, double length_mm, double bent_mm,
                              Random& random) {
  constexpr int kWaves = 200, kPerPlate = 500;
  std::vector<Vector3> waves;
  std::vector<double> phases;
  for (int i = 0; i < kWaves; ++i) {
    waves.push_back(random.normal3() / length_mm);
    phases.push_back(random.uniform(0.0, 6.283185307179586));
  }
  std::vector<PlanePair> pairs;
  for (int plate = 0; plate < 6; ++plate) {
    const Matrix3 turn = exp_so3(Vector3(0.3 * (plate % 2 ? 1 : -1), 0.25 * (plate - 2.5), 0.0));
    const Vector3 centre(30.0 * (plate - 2.5), plate % 2 ? 18.0 : -18.0, -2.0 * std::abs(plate - 2.5));
    for (int i = 0; i < kPerPlate; ++i) {
      const Vector3 on(random.uniform(-15.0, 15.0), random.uniform(-15.0, 15.0), 0.0);
      // A plate's sides are seen, too: without them nothing holds it sideways.
      const bool side = i % 4 == 0;
      const Vector3 local = side ? Vector3(on.x() > 0 ? 15.0 : -15.0, on.y(), -2.0 * random.uniform()) : on;
      const Vector3 normal = turn * (side ? Vector3(on.x() > 0 ? 1.0 : -1.0, 0, 0) : Vector3::UnitZ());
      const Vector3 p = centre + turn * local;
      double field = 0.0;
      for (int k = 0; k < kWaves; ++k)
        field += std::cos(waves[std::size_t(k)].dot(p) + phases[std::size_t(k)]);
      const double from_rim_mm = 15.0 - std::max(std::abs(local.x()), std::abs(local.y()));
      const double r = white_mm * random.normal() + correlated_mm * std::sqrt(2.0 / kWaves) * field -
                       bent_mm * std::exp(-from_rim_mm / 1.5) * (local.x() > 0 ? 1.0 : 0.0);
      pairs.push_back({p + r * normal, p, normal, static_cast<std::uint32_t>(pairs.size()), 1.0});
    }
  }
  return pairs;
}

ScoreRows rows_of(const std::vector<PlanePair>& pairs) {
  ScoreRows rows(6, static_cast<long>(pairs.size()));
  for (std::size_t i = 0; i < pairs.size(); ++i) rows.col(static_cast<long>(i)) = pairs[i].jacobian({});
  return rows;
}

/// Squared movement of a point 60 mm behind the plates, as the teeth are.
double at_teeth2(const Vector6& xi) {
  return (Rigid3(exp_se3(xi)) * Vector3(0, 0, -60) - Vector3(0, 0, -60)).squaredNorm();
}

struct Trials {
  double ordinary_mm = 0, generalised_mm = 0, nees = 0, disagreement = 0, rest = 0;
};

Trials run(int count, double bent_mm, std::uint64_t seed) {
  Trials t;
  Random random(seed);
  for (int i = 0; i < count; ++i) {
    const std::vector<PlanePair> pairs = plates(0.03, 0.03, 10.0, bent_mm, random);
    const ResidualNoise noise = estimate_noise(pairs, {});
    const PatchModel patches(pairs, noise);
    const GeneralisedScore s = patches.score(pairs, {}, rows_of(pairs));
    const Vector6 xi = -s.information.ldlt().solve(s.score);
    Vector6 score = Vector6::Zero();
    for (const PlanePair& p : pairs) score += p.jacobian({}) * p.residual_mm({});
    const Vector6 ordinary = -information(pairs, {}).ldlt().solve(score);
    t.generalised_mm += at_teeth2(xi) / count;
    t.ordinary_mm += at_teeth2(ordinary) / count;
    t.nees += xi.dot(s.information * xi) / 6 / count;
    const Disagreement d = patches.disagreement(pairs, {}, rows_of(pairs), {});
    t.disagreement += d.chi2 / d.freedom / count;
    t.rest += d.rest_chi2 / d.rest_freedom / count;
  }
  t.generalised_mm = std::sqrt(t.generalised_mm);
  t.ordinary_mm = std::sqrt(t.ordinary_mm);
  std::printf("ordinary %.4f mm, generalised %.4f mm, NEES/6 %.2f, disagreement %.2f, rest %.2f\n",
              t.ordinary_mm, t.generalised_mm, t.nees, t.disagreement, t.rest);
  return t;
}

TEST(PatchFit, HalvesTheErrorOfCorrelatedNoiseAndSaysHowGoodItIs) {
  const Trials t = run(40, 0.0, 20261123);
  EXPECT_LT(t.generalised_mm, 0.6 * t.ordinary_mm);
  // 240 degrees of freedom, and V estimated from the residuals.
  EXPECT_GT(t.nees, 0.7);
  EXPECT_LT(t.nees, 1.5);
  EXPECT_GT(t.disagreement, 0.5);
  EXPECT_LT(t.disagreement, 1.8);
  EXPECT_GT(t.rest, 0.7);
  EXPECT_LT(t.rest, 1.1);
}

TEST(PatchFit, APatchThatLostItsPairsSaysNothing) {
  Random random(20261125);
  const std::vector<PlanePair> all = plates(0.03, 0.03, 10.0, 0.0, random);
  const ResidualNoise noise = estimate_noise(all, {});
  std::vector<PlanePair> pairs = all;
  for (PlanePair& p : pairs)
    if (p.target_mm.x() > 60.0) p.weight = 0.0;
  const PatchModel of_all(all, noise), of_left(pairs, noise);
  const GeneralisedScore a = of_all.score(pairs, {}, rows_of(pairs)),
                         b = of_left.score(pairs, {}, rows_of(pairs));
  EXPECT_LT((a.information - b.information).norm(), 0.02 * b.information.norm());
  EXPECT_LT((a.score - b.score).norm(), 0.02 * of_all.score(all, {}, rows_of(all)).score.norm());
}

TEST(PatchFit, BentPlatesAreNoNoise) {
  // Either tells: ordinary fits of slightly bent plates are still right within their own large error.
  const Trials slightly = run(10, 0.15, 20261124), much = run(10, 0.6, 20261124);
  EXPECT_GT(slightly.rest, 1.3);
  EXPECT_GT(much.disagreement, 3.5);
}

/// The same body in two scans, each with a noise of its own; `bent_mm`: its ends against its model, in both.
struct TwoScans {
  std::vector<PlanePair> pairs[2];
  std::vector<PatchModel> patches;
  std::vector<ShapeFit> fits;

  TwoScans(double bent_mm, Random& random) {
    patches.reserve(2);
    for (auto& scan : pairs) {
      scan = plates(0.03, 0.03, 10.0, 0.0, random);
      for (PlanePair& p : scan) {
        const double t = p.target_mm.x() / 75.0;
        p.source_mm += bent_mm * t * t * p.normal.z() * p.normal;
      }
    }
    make_fits();
  }
  void correct(const BodyShape& shape) {
    for (auto& scan : pairs)
      for (PlanePair& p : scan) p.target_mm += shape.along_mm(p.normal, p.target_mm) * p.normal;
    make_fits();
  }
  void make_fits() {
    patches.clear();
    fits.clear();
    for (auto& scan : pairs) {
      patches.emplace_back(scan, estimate_noise(scan, {}));
      fits.push_back({&patches.back(), &scan, Rigid3::identity(), rows_of(scan)});
    }
  }
};
const ShapeModes kModes{Vector3::Zero(), 75.0};

TEST(SharedShape, NoiseIsNotShared) {
  Random random(20261126);
  double mean = 0.0;
  for (int i = 0; i < 20; ++i) {
    const TwoScans scans(0.0, random);
    const SharedShape shape = shared_shape(scans.fits, kModes);
    EXPECT_GT(shape.freedom, 15);
    mean += shape.ratio / 20;
  }
  EXPECT_GT(mean, 0.6);
  EXPECT_LT(mean, 1.6);
}

TEST(SharedShape, ABendIsFoundAndMeasured) {
  constexpr double kBent_mm = 0.3;
  Random random(20261127);
  for (int i = 0; i < 5; ++i) {
    TwoScans scans(kBent_mm, random);
    EXPECT_GT(shared_shape(scans.fits, kModes).ratio, 2.0);
    // At first the bend is part of what is taken for noise; beside it the noise is seen as it is.
    const BodyShape first = estimated_shape(scans.fits, kModes, 0.3, nullptr);
    scans.correct(first);
    const BodyShape shape = estimated_shape(scans.fits, kModes, 0.3, &first);
    // What a rigid motion does not do: both ends against the middle.
    const Vector3 z = Vector3::UnitZ();
    const double bend_mm =
        0.5 * (shape.along_mm(z, Vector3(75, 0, 0)) + shape.along_mm(z, Vector3(-75, 0, 0))) -
        shape.along_mm(z, Vector3::Zero());
    EXPECT_NEAR(bend_mm, kBent_mm, 0.05);
  }
}

}  // namespace
}  // namespace gnathion
