#include "calibration/composition.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <nlohmann/json.hpp>

#include "calibration/chain_derived.h"
#include "calibration/chain_json.h"
#include "calibration/se3_manifold.h"
#include "core/mesh_io.h"
#include "core/random.h"
#include "registration/scan_like_testing.h"

namespace gnathion {
namespace {

using namespace testing_surfaces;

Matrix6 some_covariance(Random& random, double sigma_rad, double sigma_mm) {
  Matrix6 a;
  for (int r = 0; r < 6; ++r) {
    for (int c = 0; c < 6; ++c)
      a(r, c) = (r == c ? 1.0 : 0.4) * random.normal() * (r < 3 ? sigma_rad : sigma_mm);
  }
  return a * a.transpose() + 1e-4 * Matrix6::Identity() * sigma_rad * sigma_rad;
}

Vector6 draw(Random& random, const Matrix6& covariance) {
  Vector6 z;
  for (int k = 0; k < 6; ++k) z[k] = random.normal();
  return Matrix6(covariance.llt().matrixL()) * z;
}

/// A chain with poses as a session has them and a full joint covariance.
Chain some_chain(Random& random) {
  Chain chain;
  chain.bow_from_dental.value = random_pose(random, 40);
  chain.bow_from_face.value = random_pose(random, 200);
  chain.face_mi_from_face_tp.value = random_pose(random, 200);
  const Rigid3 opening = Rigid3::about_axis({0, 80, 30}, Vector3::UnitX(), 0.06);
  // B1 such that T_th is `opening`: T_D⁻¹·T_F·F·B1⁻¹·T_D.
  const Rigid3 &td = chain.bow_from_dental.value, &tf = chain.bow_from_face.value,
               &f = chain.face_mi_from_face_tp.value;
  chain.bow_from_face_tp.value = td * opening.inverse() * td.inverse() * tf * f;
  ChainCovariance a;
  for (int r = 0; r < a.rows(); ++r) {
    for (int c = 0; c < a.cols(); ++c)
      a(r, c) = (r == c ? 1.0 : 0.3) * random.normal() * (r % 6 < 3 ? 2e-4 : 0.02);
  }
  chain.joint = a * a.transpose() + 1e-12 * ChainCovariance::Identity();
  const std::array<ChainPose*, 4> poses = {&chain.bow_from_dental, &chain.bow_from_face,
                                           &chain.bow_from_face_tp, &chain.face_mi_from_face_tp};
  for (int k = 0; k < 4; ++k)
    poses[static_cast<std::size_t>(k)]->covariance = chain.joint.block<6, 6>(6 * k, 6 * k);
  return chain;
}

Chain perturbed(const Chain& chain, const Eigen::Matrix<double, 24, 1>& xi) {
  Chain moved = chain;
  moved.bow_from_dental.value = exp_se3(Vector6(xi.segment<6>(0))) * chain.bow_from_dental.value;
  moved.bow_from_face.value = exp_se3(Vector6(xi.segment<6>(6))) * chain.bow_from_face.value;
  moved.bow_from_face_tp.value = exp_se3(Vector6(xi.segment<6>(12))) * chain.bow_from_face_tp.value;
  moved.face_mi_from_face_tp.value = exp_se3(Vector6(xi.segment<6>(18))) * chain.face_mi_from_face_tp.value;
  return moved;
}

TEST(ChainDerived, AgreesWithItsDefinitions) {
  Random random(1);
  Chain chain = some_chain(random);
  chain.dental_from_face.value = dental_from_face_of(chain).value;
  chain.bow_motion.value = bow_motion_of(chain).value;
  const Rigid3 t = chain.bow_from_dental.value.inverse() * chain.bow_from_face.value;
  EXPECT_LT(difference(chain.dental_from_face.value, t).norm(), 1e-9);
  // T_th = T·T_B·T⁻¹ by the typed function of the method.
  const Motion<Dental> th = express_in(chain.t(), chain.t_b());
  EXPECT_LT(difference(therapeutic_of(chain).value, th.rigid).norm(), 1e-9);
}

TEST(ChainDerived, JacobiansMatchFiniteDifferences) {
  Random random(2);
  const Chain chain = some_chain(random);
  for (auto* of : {&dental_from_face_of, &bow_motion_of, &therapeutic_of}) {
    const ChainDerived at = of(chain);
    for (int k = 0; k < 24; ++k) {
      constexpr double h = 1e-6;
      Eigen::Matrix<double, 24, 1> step = Eigen::Matrix<double, 24, 1>::Zero();
      step[k] = h;
      const Vector6 numeric =
          difference(of(perturbed(chain, step)).value, of(perturbed(chain, -step)).value) / (2 * h);
      EXPECT_LT((numeric - at.jacobian.col(k)).norm(), 1e-4 * (1.0 + numeric.norm())) << "column " << k;
    }
  }
}

// The formula of the method with its cross terms, (I−Ad_th)Σ_T(I−Ad_th)ᵀ + Ad_T Σ_B Ad_Tᵀ + cross, is the
// joint one.
TEST(Composition, JointCovarianceEqualsMethodsFormula) {
  Random random(3);
  const Chain chain = some_chain(random);
  const ChainDerived t = dental_from_face_of(chain), b = bow_motion_of(chain);
  const Matrix6 by_t = Matrix6::Identity() - adjoint(therapeutic_of(chain).value), by_b = adjoint(t.value);
  const Matrix6 s_t = t.jacobian * chain.joint * t.jacobian.transpose(),
                s_b = b.jacobian * chain.joint * b.jacobian.transpose(),
                cross = t.jacobian * chain.joint * b.jacobian.transpose();
  const Matrix6 formula = by_t * s_t * by_t.transpose() + by_b * s_b * by_b.transpose() +
                          by_t * cross * by_b.transpose() + by_b * cross.transpose() * by_t.transpose();
  const Matrix6 joint = therapeutic_from_faces(chain).therapeutic.covariance;
  EXPECT_LT((formula - joint).norm(), 1e-6 * joint.norm());
}

TEST(Composition, FaceRouteCovarianceMatchesMonteCarlo) {
  Random random(4);
  const Chain chain = some_chain(random);
  const TherapeuticEstimate e = therapeutic_from_faces(chain);
  const ChainCovariance root = chain.joint.llt().matrixL();
  constexpr int kDraws = 4000;
  double nees = 0.0;
  const Eigen::LDLT<Matrix6> inverse(e.therapeutic.covariance);
  for (int i = 0; i < kDraws; ++i) {
    Eigen::Matrix<double, 24, 1> z;
    for (int k = 0; k < 24; ++k) z[k] = random.normal();
    const Vector6 xi =
        difference(therapeutic_of(perturbed(chain, root * z)).value, e.therapeutic.value.rigid);
    nees += xi.dot(inverse.solve(xi)) / 6.0 / kDraws;
  }
  EXPECT_NEAR(nees, 1.0, 0.05);
}

TEST(Composition, CameraRouteValueAndCovariance) {
  Random random(5);
  ChainPose t_d;
  t_d.value = random_pose(random, 30);
  t_d.covariance = some_covariance(random, 5e-4, 0.03);
  const Rigid3 truth = Rigid3::about_axis({3, 85, 30}, {1, 0.1, 0}, 0.07);
  Uncertain<Transform<HeadFrame, Bow>> k0, k1;
  k0.value.rigid = random_pose(random, 100);
  k1.value.rigid = k0.value.rigid * t_d.value * truth * t_d.value.inverse();
  k0.covariance = some_covariance(random, 2e-4, 0.02);
  k1.covariance = some_covariance(random, 3e-4, 0.02);
  const TherapeuticEstimate e = therapeutic_from_camera(t_d, k0, k1);
  EXPECT_LT(difference(e.therapeutic.value.rigid, truth).norm(), 1e-9);

  // The head moves between the two times; the other form of the route must not notice.
  BowAndHead<Camera> at_mi, at_tp;
  at_mi.f_from_head.rigid = random_pose(random, 300);
  at_tp.f_from_head.rigid = random_pose(random, 300);
  at_mi.f_from_bow.rigid = at_mi.f_from_head.rigid * k0.value.rigid;
  at_tp.f_from_bow.rigid = at_tp.f_from_head.rigid * k1.value.rigid;
  const TherapeuticEstimate f = therapeutic_from_camera(t_d, at_mi, at_tp, Matrix6::Zero());
  EXPECT_LT(difference(f.therapeutic.value.rigid, truth).norm(), 1e-8);
  EXPECT_LT((e.by_bow_from_dental - f.by_bow_from_dental).norm(), 1e-8 * e.by_bow_from_dental.norm());

  constexpr int kDraws = 4000;
  double nees = 0.0;
  const Eigen::LDLT<Matrix6> inverse(e.therapeutic.covariance);
  for (int i = 0; i < kDraws; ++i) {
    ChainPose d = t_d;
    d.value = exp_se3(draw(random, t_d.covariance)) * d.value;
    auto a = k0, b = k1;
    a.value.rigid = exp_se3(draw(random, k0.covariance)) * a.value.rigid;
    b.value.rigid = exp_se3(draw(random, k1.covariance)) * b.value.rigid;
    const Vector6 xi = difference(therapeutic_from_camera(d, a, b).therapeutic.value.rigid, truth);
    nees += xi.dot(inverse.solve(xi)) / 6.0 / kDraws;
  }
  EXPECT_NEAR(nees, 1.0, 0.05);
}

/// Two routes that share one T_D error and have noise of their own.
struct TwoRoutes {
  Rigid3 truth = Rigid3::about_axis({0, 85, 30}, Vector3::UnitX(), 0.05);
  Matrix6 shared, own_a, own_b, by_d;
  explicit TwoRoutes(Random& random)
      : shared(some_covariance(random, 5e-4, 0.05)),
        own_a(some_covariance(random, 3e-4, 0.03)),
        own_b(some_covariance(random, 2e-4, 0.02)),
        by_d(adjoint(truth) - Matrix6::Identity()) {}
  std::array<TherapeuticEstimate, 2> drawn(Random& random) const {
    const Vector6 common = by_d * draw(random, shared);
    std::array<TherapeuticEstimate, 2> out;
    for (int k = 0; k < 2; ++k) {
      const Matrix6& own = k == 0 ? own_a : own_b;
      TherapeuticEstimate& e = out[static_cast<std::size_t>(k)];
      e.by_bow_from_dental = by_d;
      e.therapeutic.value = Motion<Dental>(exp_se3(Vector6(common + draw(random, own))) * truth);
      e.therapeutic.covariance = own + by_d * shared * by_d.transpose();
    }
    return out;
  }
};

TEST(Composition, FusedRouteIsBetterAndSaysHowGood) {
  Random random(6);
  const TwoRoutes routes(random);
  constexpr int kDraws = 3000;
  double nees = 0.0, mahalanobis2 = 0.0, fused_sum = 0.0, best_sum = 0.0;
  int inconsistent = 0;
  const Vector3 molar(22, 35, 0);
  for (int i = 0; i < kDraws; ++i) {
    const auto [a, b] = routes.drawn(random);
    const TherapeuticEstimate f = fuse_routes(a, b, routes.shared);
    const Vector6 xi = difference(f.therapeutic.value.rigid, routes.truth);
    nees += xi.dot(f.therapeutic.covariance.ldlt().solve(xi)) / 6.0 / kDraws;
    fused_sum += (f.therapeutic.value * molar - routes.truth * molar).squaredNorm();
    best_sum += (b.therapeutic.value * molar - routes.truth * molar).squaredNorm();
    const RouteComparison c = compare_routes(a, b, routes.shared, {molar});
    mahalanobis2 += c.mahalanobis * c.mahalanobis / 6.0 / kDraws;
    inconsistent += c.consistent ? 0 : 1;
  }
  EXPECT_NEAR(nees, 1.0, 0.06);
  EXPECT_NEAR(mahalanobis2, 1.0, 0.06);
  EXPECT_LT(fused_sum, best_sum);
  EXPECT_LT(inconsistent, 25);  // 9 of 3000 expected at p < 0.003
}

TEST(Composition, RoutesThatDisagreeAreNamed) {
  Random random(7);
  const TwoRoutes routes(random);
  auto [a, b] = routes.drawn(random);
  b.therapeutic.value = Motion<Dental>(Rigid3::from_translation({0, 0, 0.6}) * b.therapeutic.value.rigid);
  const RouteComparison c = compare_routes(a, b, routes.shared, {Vector3(0, 0, 0)});
  EXPECT_FALSE(c.consistent);
  EXPECT_GT(c.largest_mm, 0.3);
}

TEST(Composition, DisplacementBoundsHoldAtLeast95Percent) {
  Random random(8);
  Uncertain<Motion<Dental>> th;
  th.value = Motion<Dental>(Rigid3::about_axis({0, 85, 30}, Vector3::UnitX(), 0.05));
  th.covariance = some_covariance(random, 1e-3, 0.05);
  const std::vector<Vector3> landmarks = {Vector3(0, 0, 0), Vector3(22, 35, 2), Vector3(-50, 90, 40)};
  const auto bounds = displacement_bounds(th, landmarks);
  ASSERT_EQ(bounds.size(), 3u);
  for (std::size_t k = 0; k < landmarks.size(); ++k) {
    int inside = 0;
    for (int i = 0; i < 2000; ++i) {
      const Rigid3 x = exp_se3(draw(random, th.covariance)) * th.value.rigid;
      inside += (x * landmarks[k] - th.value * landmarks[k]).norm() <= bounds[k].bound95_mm ? 1 : 0;
    }
    EXPECT_GE(inside, 1880);
    EXPECT_NEAR(bounds[k].length_mm, (th.value * landmarks[k] - landmarks[k]).norm(), 1e-12);
  }
}

TEST(Se3Manifold, PlusMinusAndJacobians) {
  Random random(9);
  const Se3Manifold manifold;
  for (int i = 0; i < 20; ++i) {
    const PoseParameters x = pose_parameters(random_pose(random, 100));
    Vector6 xi;
    for (int k = 0; k < 6; ++k) xi[k] = (k < 3 ? 0.7 : 20.0) * random.normal();
    PoseParameters y;
    manifold.Plus(x.data(), xi.data(), y.data());
    Vector6 back;
    manifold.Minus(y.data(), x.data(), back.data());
    EXPECT_LT((exp_se3(back).matrix() - exp_se3(xi).matrix()).norm(), 1e-9);
    EXPECT_LT(
        (rigid_from_parameters(y.data()).matrix() - (exp_se3(xi) * rigid_from_parameters(x.data())).matrix())
            .norm(),
        1e-9);

    Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
    Eigen::Matrix<double, 6, 7, Eigen::RowMajor> minus;
    manifold.PlusJacobian(x.data(), plus.data());
    manifold.MinusJacobian(x.data(), minus.data());
    EXPECT_LT((minus * plus - Matrix6::Identity()).norm(), 1e-9);
    for (int k = 0; k < 6; ++k) {
      constexpr double h = 1e-6;
      Vector6 step = Vector6::Zero();
      step[k] = h;
      PoseParameters up, down;
      manifold.Plus(x.data(), step.data(), up.data());
      step[k] = -h;
      manifold.Plus(x.data(), step.data(), down.data());
      EXPECT_LT(((up - down) / (2 * h) - plus.col(k)).norm(), 1e-5);
    }
  }
}

TEST(ChainJson, RoundTripsWithoutLoss) {
  Random random(10);
  Chain chain = some_chain(random);
  chain.dental_from_face.value = dental_from_face_of(chain).value;
  chain.bow_motion.value = bow_motion_of(chain).value;
  chain.bow_from_dental.rms_mm = 0.02;
  chain.bow_from_dental.held_out_mm = 0.021;
  chain.bow_from_dental.weak = {"rotation about axis (1.00 0.00 0.00) is weak: 0.40 deg"};
  const auto back = chain_from_json(nlohmann::json::parse(chain_json(chain).dump()), "chain.json");
  ASSERT_TRUE(back) << back.error().line();
  EXPECT_LT((back->bow_from_face.value.matrix() - chain.bow_from_face.value.matrix()).norm(), 1e-9);
  EXPECT_EQ(back->joint, chain.joint);
  EXPECT_EQ(back->bow_from_dental.weak, chain.bow_from_dental.weak);
  EXPECT_DOUBLE_EQ(back->bow_from_dental.held_out_mm, 0.021);
}

TEST(ChainJson, RefusesBadFiles) {
  Random random(11);
  const nlohmann::json good = chain_json(some_chain(random));
  nlohmann::json missing = good, sheared = good, short_joint = good;
  missing.erase("bow_from_dental");
  sheared["bow_from_face"]["matrix"][0][0] = 3.0;
  short_joint["joint"]["covariance"].erase(0);
  for (const nlohmann::json& j : {missing, sheared, short_joint, nlohmann::json::array()}) {
    const auto read = chain_from_json(j, "chain.json");
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, ErrorCode::kInput);
  }
}

// Appendix A.1 on real jaws: both arches scanned again in TP, in a frame of their own.
TEST(TwoScans, RealJawsMovedByKnownMotion) {
  const auto folder = shared_data() / "jaws" / "crowns";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no real jaws here: set GNATHION_SHARED";
  const TriangleMesh upper = *read_mesh(folder / "maxilla.stl"),
                     lower = *read_mesh(folder / "mandible_mi.stl");
  Random random(77);
  const auto scanned = [&](const TriangleMesh& m) {
    return noisy(with_holes(retessellated(m, 0.6, random), 5, 1.0, random), 0.014, 0.0, 10, random);
  };
  const Vector3 hinge = surface_centroid_mm(lower) + Vector3(0, 30, -60);
  const Rigid3 truth =
      Rigid3::about_axis(hinge, Vector3::UnitX(), 0.06) * Rigid3::from_translation({0.4, -0.3, 1.0});
  const Rigid3 tp_frame = random_pose(random, 60);
  SilentProgress silent;
  const auto found =
      therapeutic_from_scans(scanned(upper), scanned(lower), transformed(tp_frame, scanned(upper)),
                             transformed(tp_frame * truth, scanned(lower)), {}, silent);
  ASSERT_TRUE(found) << found.error().line();
  const PoseError error = pose_error(found->therapeutic.value.rigid, truth, lower);
  EXPECT_LE(error.rms_mm, 0.015);
  EXPECT_LE(error.max_mm, 0.03);
  const Vector6 xi = difference(found->therapeutic.value.rigid, truth);
  EXPECT_LT(xi.dot(found->therapeutic.covariance.ldlt().solve(xi)), 22.5) << "χ² of 6 at p = 0.001";
}

TEST(TwoScans, OtherPatientsJawIsRefused) {
  const auto jaws = shared_data() / "jaws";
  if (!std::filesystem::exists(jaws)) GTEST_SKIP() << "no real jaws here: set GNATHION_SHARED";
  SilentProgress silent;
  const TriangleMesh upper = *read_mesh(jaws / "crowns" / "maxilla.stl");
  const TriangleMesh lower = *read_mesh(jaws / "crowns" / "mandible_mi.stl");
  const auto found =
      therapeutic_from_scans(upper, lower, *read_mesh(jaws / "cast" / "maxilla.stl"), lower, {}, silent);
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().code, ErrorCode::kInput);
  EXPECT_NE(found.error().line().find("maxilla"), std::string::npos);
}

TEST(Chain, ScansInMetresAreRefused) {
  ChainScans scans;
  scans.mandible_mi.vertices_mm = {{0, 0, 0}, {0.06, 0, 0}, {0, 0.05, 0}};
  scans.mandible_mi.triangles = {{0, 1, 2}};
  SilentProgress silent;
  const auto chain = solve_chain(scans, {}, silent);
  ASSERT_FALSE(chain);
  EXPECT_EQ(chain.error().code, ErrorCode::kInput);
  EXPECT_NE(chain.error().why.find("metres"), std::string::npos) << chain.error().line();
}

}  // namespace
}  // namespace gnathion
