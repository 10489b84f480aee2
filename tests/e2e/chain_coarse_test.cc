// A face scanner that is too coarse for T_F: the chain solves, says so by name, and its prediction holds.
#include <gtest/gtest.h>

#include <cmath>

#include "calibration/chain.h"
#include "phantom/case.h"
#include "phantom/case_scans.h"
#include "phantom/face.h"
#include "phantom/patient.h"
#include "phantom/scanner.h"

namespace gnathion {
namespace {

constexpr std::uint64_t kSeed = 31;

struct Scene {
  PhantomPatient patient = make_phantom_patient(kSeed);
  PhantomScanPoses poses = phantom_scan_poses(kSeed);
  ChainScans scans;

  Scene() {
    scans.mandible_mi = simulate_phantom_scan(patient, poses, PhantomScanKind::kMandibleMi, kSeed);
    scans.clutch_scans = {simulate_phantom_scan(patient, poses, PhantomScanKind::kMandibleClutch, kSeed)};
    scans.bow_model = patient.bow.surface;
    scans.head_frame_model = patient.head_frame.surface;
  }

  /// The head with bow and head frame, the mandible moved, as a face scanner of this noise delivers it.
  TriangleMesh face_scan(const Motion<Dental>& mandible, const Rigid3& scan_from_dental, double noise_mm,
                         std::uint64_t seed) const {
    const Rigid3 dental_from_bow = mandible.rigid * patient.bow_from_dental.rigid.inverse();
    const TriangleMesh bow = transformed(dental_from_bow, patient.bow.surface);
    const TriangleMesh frame =
        transformed(patient.head_from_dental.rigid.inverse(), patient.head_frame.surface);
    ScannerModel model = face_scanner(-Vector3::UnitY(), Vector3::UnitZ());
    model.white_noise_mm = 0.6 * noise_mm;
    model.correlated_noise_mm = 0.8 * noise_mm;
    Random random(seed);
    return simulate_scan(merged(merged(patient.face, bow), frame), model, scan_from_dental, random);
  }
};

/// Of T_F at the teeth, RMS.
double off_mm(const Scene& s, const Chain& chain) {
  const Rigid3 error =
      chain.bow_from_face.value * phantom_truth(s.patient, s.poses).bow_from_face.rigid.inverse();
  double sum = 0;
  for (const Vector3& p : s.patient.jaws.mandible_mi.vertices_mm) {
    const Vector3 in_bow = s.patient.bow_from_dental.rigid * p;
    sum += (error * in_bow - in_bow).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(s.patient.jaws.mandible_mi.vertices_mm.size()));
}

Result<Chain> solved(Scene& s, double noise_mm) {
  s.scans.faces_mi = {s.face_scan({}, s.poses.face_mi_from_dental.rigid, noise_mm, 1)};
  s.scans.faces_tp = {s.face_scan(s.patient.therapeutic, s.poses.face_tp_from_dental.rigid, noise_mm, 2)};
  SilentProgress silent;
  return solve_chain(s.scans, {}, silent);
}

TEST(CoarseFaceScanner, BelowTheLimitItsErrorIsStillAsPredicted) {
  Scene s;
  const auto chain = solved(s, 0.35);
  ASSERT_TRUE(chain) << chain.error().line();
  printf("T_F at the teeth: predicted %.3f mm, true error %.3f mm\n", chain->face_mi.at_teeth_mm,
         off_mm(s, *chain));
  EXPECT_LT(off_mm(s, *chain), 3 * chain->face_mi.at_teeth_mm);
  EXPECT_LE(chain->face_mi.at_teeth_mm, kLargestFaceScanError_mm);
  EXPECT_TRUE(chain->warnings.empty()) << chain->warnings[0];
}

TEST(CoarseFaceScanner, IsNamedAndItsErrorWasPredicted) {
  constexpr double kNoise_mm = 0.5;
  Scene s;
  const auto chain = solved(s, kNoise_mm);
  ASSERT_TRUE(chain) << chain.error().line();
  const double off = off_mm(s, *chain);
  printf("deviation %.3f mm (made with %.2f), T_F at the teeth: predicted %.3f mm, true error %.3f mm\n",
         chain->face_mi.deviation_mm, kNoise_mm, chain->face_mi.at_teeth_mm, off);
  for (const std::string& w : chain->warnings) printf("%s\n", w.c_str());
  EXPECT_NEAR(chain->face_mi.deviation_mm, kNoise_mm, 0.12);
  EXPECT_GT(chain->face_mi.at_teeth_mm, kLargestFaceScanError_mm);
  EXPECT_LT(off, 3 * chain->face_mi.at_teeth_mm);
  ASSERT_EQ(chain->warnings.size(), 2u);
  EXPECT_EQ(chain->warnings[0].find("face scan in MI too coarse for T_F: deviation 0."), 0u)
      << chain->warnings[0];
  EXPECT_EQ(chain->warnings[1].find("face scan in TP too coarse for T_F"), 0u) << chain->warnings[1];
}

}  // namespace
}  // namespace gnathion
