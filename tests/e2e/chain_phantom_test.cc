// The chain T_D, T_F, T, T_B and T_th from the phantom's scans, against its truth.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <vector>

#include "calibration/chain.h"
#include "calibration/composition.h"
#include "core/random.h"
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

ChainScans scans_of(const PhantomPatient& patient, const PhantomScanPoses& poses, std::uint64_t seed) {
  const auto scan = [&](PhantomScanKind kind) { return simulate_phantom_scan(patient, poses, kind, seed); };
  ChainScans scans;
  scans.mandible_mi = scan(PhantomScanKind::kMandibleMi);
  scans.clutch_scans = {scan(PhantomScanKind::kMandibleClutch)};
  scans.faces_mi = {scan(PhantomScanKind::kFaceMi)};
  scans.faces_tp = {scan(PhantomScanKind::kFaceTp)};
  scans.bow_model = patient.bow.surface;
  scans.head_frame_model = patient.head_frame.surface;
  return scans;
}

class ChainOnPhantom : public ::testing::TestWithParam<std::uint64_t> {};

TEST_P(ChainOnPhantom, FindsTruth) {
  const std::uint64_t seed = GetParam();
  const PhantomPatient patient = make_phantom_patient(seed);
  const PhantomScanPoses poses = phantom_scan_poses(seed);
  const PhantomTruth truth = phantom_truth(patient, poses);
  const auto scan = [&](PhantomScanKind kind) { return simulate_phantom_scan(patient, poses, kind, seed); };
  const ChainScans scans = scans_of(patient, poses, seed);
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

/// A tracker's poses with 0.01 mm and 0.005 deg about `about_mm` (of the bow), as it states them.
Uncertain<Transform<HeadFrame, Bow>> seen(const Rigid3& truth, const Vector3& about_mm, Random& rng) {
  constexpr double kSigma_mm = 0.01, kSigma_rad = 0.005 / 57.29577951308232;
  const Vector3 at = truth * about_mm;
  const Matrix6 about = adjoint(Rigid3::from_translation(at));
  Vector6 xi;
  Matrix6 own = Matrix6::Zero();
  for (int k = 0; k < 6; ++k) {
    const double sigma = k < 3 ? kSigma_rad : kSigma_mm;
    xi[k] = sigma * rng.normal();
    own(k, k) = sigma * sigma;
  }
  const Rigid3 noisy = exp_se3(about * xi) * truth;
  return {Transform<HeadFrame, Bow>(noisy), about * own * about.transpose()};
}

// A tracker's MI and TP enter the problem only where they agree with the scans.
TEST(ChainWithTracker, AgreesOrIsRefused) {
  constexpr std::uint64_t kSeed = 23;
  const PhantomPatient patient = make_phantom_patient(kSeed);
  const PhantomScanPoses poses = phantom_scan_poses(kSeed);
  ChainScans scans = scans_of(patient, poses, kSeed);
  SilentProgress silent;
  const auto alone = solve_chain(scans, {}, silent);
  ASSERT_TRUE(alone) << alone.error().line();

  // K = H⁻¹·M: head frame and bow as truth has them, in MI and in TP.
  const Rigid3 mi = patient.head_from_dental.rigid * patient.bow_from_dental.rigid.inverse();
  const Rigid3 tp =
      patient.head_from_dental.rigid * patient.therapeutic.rigid * patient.bow_from_dental.rigid.inverse();
  const Vector3 teeth_mm = patient.bow_from_dental.rigid * patient.jaws.landmarks.lower_incisal_point_mm;
  Random rng(kSeed);
  ChainOptions options;
  options.tracked = TrackedPositions{seen(mi, teeth_mm, rng), seen(tp, teeth_mm, rng)};
  const auto chain = solve_chain(scans, options, silent);
  ASSERT_TRUE(chain) << chain.error().line();
  ASSERT_TRUE(chain->tracked);
  EXPECT_LT(chain->tracked->therapeutic_mm, 0.25);
  ASSERT_TRUE(chain->tracked->head_from_bow_mm);
  // The tracker knows T_B better than the scans (by less since these are fitted by generalised least
  // squares): so does the chain now, and says so.
  const auto before = therapeutic_from_faces(*alone), after = therapeutic_from_faces(*chain);
  const TriangleMesh& arch = patient.jaws.mandible_mi;
  EXPECT_LE(error_at_teeth(after.therapeutic.value.rigid, patient.therapeutic.rigid, {}, arch).max_mm, 0.05);
  EXPECT_LT(after.therapeutic.covariance.trace(), 0.4 * before.therapeutic.covariance.trace());
  EXPECT_LT(chi2(after.therapeutic.value.rigid, after.therapeutic.covariance, patient.therapeutic.rigid),
            27.9);
  EXPECT_LT(
      chi2(chain->bow_from_dental.value, chain->bow_from_dental.covariance, patient.bow_from_dental.rigid),
      27.9);

  // Repeated scans, two of each, know T_D better, and say so; T_F of the first face scan leans mostly on that
  // scan itself.
  const ChainScans more = scans_of(patient, phantom_scan_poses(kSeed + 1), kSeed + 1);
  scans.clutch_scans.push_back(more.clutch_scans.front());
  scans.faces_mi.push_back(more.faces_mi.front());
  scans.faces_tp.push_back(more.faces_tp.front());
  const auto repeated = solve_chain(scans, options, silent);
  ASSERT_TRUE(repeated) << repeated.error().line();
  EXPECT_LT(repeated->bow_from_dental.covariance.trace(), 0.75 * chain->bow_from_dental.covariance.trace());
  EXPECT_LT(repeated->bow_from_face.covariance.trace(), chain->bow_from_face.covariance.trace());
  EXPECT_LT(chi2(repeated->bow_from_dental.value, repeated->bow_from_dental.covariance,
                 patient.bow_from_dental.rigid),
            27.9);
  scans = scans_of(patient, poses, kSeed);

  // TP of another bite: 0.6 mm away.
  options.tracked->head_from_bow_tp.value.rigid =
      Rigid3::from_translation({0.0, 0.6, 0.0}) * options.tracked->head_from_bow_tp.value.rigid;
  const auto elsewhere = solve_chain(scans, options, silent);
  ASSERT_FALSE(elsewhere);
  EXPECT_EQ(elsewhere.error().code, ErrorCode::kGate);
  EXPECT_NE(elsewhere.error().line().find("T_th by tracker and by face scans"), std::string::npos)
      << elsewhere.error().line();

  // A head frame whose file means another frame than its CAD surface: the same in MI and TP.
  const Rigid3 shift = Rigid3::from_translation({0.0, 1.5, 0.0});
  options.tracked = TrackedPositions{seen(shift * mi, teeth_mm, rng), seen(shift * tp, teeth_mm, rng)};
  const auto shifted = solve_chain(scans, options, silent);
  ASSERT_FALSE(shifted);
  EXPECT_NE(shifted.error().line().find("head frame at MI"), std::string::npos) << shifted.error().line();
}

// A printed bow is never quite its model; all scans show the same, and no noise does that.
TEST(ChainWithBentBow, EstimatesTheBendAndTellsIt) {
  constexpr std::uint64_t kSeed = 27;
  constexpr double kBent_mm = 0.3;
  const PhantomPatient patient = make_phantom_patient(kSeed);
  const PhantomScanPoses poses = phantom_scan_poses(kSeed);
  const PhantomTruth truth = phantom_truth(patient, poses);
  ChainScans scans = scans_of(patient, poses, kSeed);
  const Box box = bounding_box(scans.bow_model);
  int longest = 0;
  const double half_mm = 0.5 * box.size_mm().maxCoeff(&longest);
  for (Vector3& p : scans.bow_model.vertices_mm) {
    const double t = (p - box.centre_mm())[longest] / half_mm;
    p[(longest + 1) % 3] += kBent_mm * t * t;
  }
  SilentProgress silent;
  const auto chain = solve_chain(scans, {}, silent);
  ASSERT_TRUE(chain) << chain.error().line();
  ASSERT_FALSE(chain->warnings.empty());
  EXPECT_NE(chain->warnings.front().find("not as its model"), std::string::npos) << chain->warnings.front();
  const ErrorAtTeeth t = error_at_teeth(chain->dental_from_face.value, truth.dental_from_face.rigid,
                                        truth.dental_from_face.rigid.inverse(), patient.jaws.mandible_mi);
  EXPECT_LE(t.max_mm, 0.1);  // 0.2 and more where the bend is taken for noise
  EXPECT_LT(
      chi2(chain->dental_from_face.value, chain->dental_from_face.covariance, truth.dental_from_face.rigid),
      27.9);
  const Uncertain<Motion<Dental>> faces = therapeutic_from_faces(*chain).therapeutic;
  EXPECT_LT(chi2(faces.value.rigid, faces.covariance, patient.therapeutic.rigid), 27.9);
}

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

  // Two of them: which is on the teeth, the scan does not say.
  const TriangleMesh worn = transformed(patient.bow_from_dental.rigid.inverse(), patient.bow.surface);
  const Rigid3 aside = Rigid3::from_translation({0.0, -180.0, -60.0});
  scans.faces_mi = {merged(merged(patient.face, worn), transformed(aside, worn))};
  scans.faces_tp = {merged(patient.face, worn)};
  const auto two_bows = solve_chain(scans, {}, silent);
  ASSERT_FALSE(two_bows);
  EXPECT_EQ(two_bows.error().code, ErrorCode::kInput);
  const std::string why = two_bows.error().line();
  EXPECT_NE(why.find("bow in face scan in MI"), std::string::npos) << why;
  EXPECT_NE(why.find("two distinct poses"), std::string::npos) << why;
}

}  // namespace
}  // namespace gnathion
