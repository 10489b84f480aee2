// The chain T_D, T_F, T, T_B and T_th from the phantom's scans, against its truth.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <vector>

#include "calibration/chain.h"
#include "calibration/composition.h"
#include "phantom/case.h"
#include "phantom/case_scans.h"
#include "phantom/patient.h"

namespace gnathion {
namespace {

struct ErrorAtTeeth {
  double max_mm = 0.0, angle_deg = 0.0;
};
/// Largest distance over the lower arch; `at_from_dental` brings it to where the poses act.
ErrorAtTeeth error_at_teeth(const Rigid3& a, const Rigid3& b, const Rigid3& at_from_dental,
                            const TriangleMesh& arch) {
  ErrorAtTeeth e;
  e.angle_deg = (a * b.inverse()).angle_rad() * 57.29577951308232;
  for (const Vector3& p : arch.vertices_mm) {
    const Vector3 at = at_from_dental * p;
    e.max_mm = std::max(e.max_mm, (a * at - b * at).norm());
  }
  return e;
}

/// ξᵀΣ⁻¹ξ of a pose against its truth.
double chi2(const Rigid3& estimate, const Matrix6& covariance, const Rigid3& truth) {
  const Vector6 xi = difference(estimate, truth);
  return xi.dot(covariance.ldlt().solve(xi));
}

class ChainOnPhantom : public ::testing::TestWithParam<std::uint64_t> {};

TEST_P(ChainOnPhantom, FindsTruth) {
  const std::uint64_t seed = GetParam();
  const PhantomPatient patient = make_phantom_patient(seed);
  const PhantomScanPoses poses = phantom_scan_poses(seed);
  const PhantomTruth truth = phantom_truth(patient, poses);
  const auto scan = [&](PhantomScanKind kind) { return simulate_phantom_scan(patient, poses, kind, seed); };
  ChainScans scans;
  scans.mandible_mi = scan(PhantomScanKind::kMandibleMi);
  scans.clutch_scans = {scan(PhantomScanKind::kMandibleClutch)};
  scans.faces_mi = {scan(PhantomScanKind::kFaceMi)};
  scans.faces_tp = {scan(PhantomScanKind::kFaceTp)};
  scans.bow_model = patient.bow.surface;
  scans.head_frame_model = patient.head_frame.surface;
  SilentProgress silent;
  const auto chain = solve_chain(scans, {}, silent);
  ASSERT_TRUE(chain) << chain.error().line();

  // The phantom's face scanner is fine enough for T_F, and says how fine it is.
  EXPECT_TRUE(chain->warnings.empty()) << chain->warnings.front();
  EXPECT_NEAR(chain->face_mi.deviation_mm, 0.058, 0.02);  // 0.05 white, 0.03 correlated
  EXPECT_GT(chain->face_mi.at_teeth_mm, 0.0);

  const TriangleMesh& arch = patient.jaws.mandible_mi;
  const ErrorAtTeeth t_d =
      error_at_teeth(chain->bow_from_dental.value, patient.bow_from_dental.rigid, {}, arch);
  EXPECT_LE(t_d.max_mm, 0.2);
  EXPECT_LE(t_d.angle_deg, 0.2);
  const ErrorAtTeeth t = error_at_teeth(chain->dental_from_face.value, truth.dental_from_face.rigid,
                                        truth.dental_from_face.rigid.inverse(), arch);
  EXPECT_LE(t.max_mm, 0.2);
  EXPECT_LE(t.angle_deg, 0.2);
  const Uncertain<Motion<Dental>> faces = therapeutic_from_faces(*chain).therapeutic;
  const ErrorAtTeeth th = error_at_teeth(faces.value.rigid, patient.therapeutic.rigid, {}, arch);
  EXPECT_LE(th.max_mm, 0.10);
  EXPECT_LE(th.angle_deg, 0.10);
  // The stated covariances do not deny the errors: χ² of 6 degrees of freedom at p = 0.0001.
  EXPECT_LT(
      chi2(chain->bow_from_dental.value, chain->bow_from_dental.covariance, patient.bow_from_dental.rigid),
      27.9);
  EXPECT_LT(chi2(chain->bow_from_face.value, chain->bow_from_face.covariance, truth.bow_from_face.rigid),
            27.9);
  EXPECT_LT(chi2(faces.value.rigid, faces.covariance, patient.therapeutic.rigid), 27.9);
  EXPECT_GT(chain->bow_from_face.held_out_mm, 0.0);

  // The third route, by the intraoral scans alone.
  const auto by_scans = therapeutic_from_scans(scan(PhantomScanKind::kMaxillaMi), scans.mandible_mi,
                                               scan(PhantomScanKind::kMaxillaTp),
                                               scan(PhantomScanKind::kMandibleTp), {}, silent);
  ASSERT_TRUE(by_scans) << by_scans.error().line();
  const ErrorAtTeeth s =
      error_at_teeth(by_scans->therapeutic.value.rigid, patient.therapeutic.rigid, {}, arch);
  EXPECT_LE(s.max_mm, 0.10);
  EXPECT_LE(s.angle_deg, 0.10);
}
INSTANTIATE_TEST_SUITE_P(Seeds, ChainOnPhantom, ::testing::Values(21u));

TEST(ChainWithoutBow, IsRefused) {
  constexpr std::uint64_t kSeed = 22;
  const PhantomPatient patient = make_phantom_patient(kSeed);
  const PhantomScanPoses poses = phantom_scan_poses(kSeed);
  ChainScans scans;
  scans.mandible_mi = simulate_phantom_scan(patient, poses, PhantomScanKind::kMandibleMi, kSeed);
  scans.clutch_scans = {simulate_phantom_scan(patient, poses, PhantomScanKind::kMandibleClutch, kSeed)};
  scans.bow_model = patient.bow.surface;
  scans.faces_mi = {patient.face};  // no bow in it
  scans.faces_tp = {patient.face};
  SilentProgress silent;
  const auto chain = solve_chain(scans, {}, silent);
  ASSERT_FALSE(chain);
  EXPECT_EQ(chain.error().code, ErrorCode::kInput);
  EXPECT_NE(chain.error().line().find("bow"), std::string::npos) << chain.error().line();
}

}  // namespace
}  // namespace gnathion
