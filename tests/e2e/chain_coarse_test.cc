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

TEST(CoarseFaceScanner, IsNamedAndItsErrorWasPredicted) {
  constexpr double kNoise_mm = 0.5;  // 0.35 mm solves well enough to need no warning
  Scene s;
  s.scans.faces_mi = {s.face_scan({}, s.poses.face_mi_from_dental.rigid, kNoise_mm, 1)};
  s.scans.faces_tp = {s.face_scan(s.patient.therapeutic, s.poses.face_tp_from_dental.rigid, kNoise_mm, 2)};
  SilentProgress silent;
  const auto chain = solve_chain(s.scans, {}, silent);
  ASSERT_TRUE(chain) << chain.error().line();

  const PhantomTruth truth = phantom_truth(s.patient, s.poses);
  const Rigid3 error = chain->bow_from_face.value * truth.bow_from_face.rigid.inverse();
  double sum = 0;
  for (const Vector3& p : s.patient.jaws.mandible_mi.vertices_mm) {
    const Vector3 in_bow = s.patient.bow_from_dental.rigid * p;
    sum += (error * in_bow - in_bow).squaredNorm();
  }
  const double off_mm = std::sqrt(sum / static_cast<double>(s.patient.jaws.mandible_mi.vertices_mm.size()));
  printf("deviation %.3f mm (made with %.2f), T_F at the teeth: predicted %.3f mm, true error %.3f mm\n",
         chain->face_mi.deviation_mm, kNoise_mm, chain->face_mi.at_teeth_mm, off_mm);
  for (const std::string& w : chain->warnings) printf("%s\n", w.c_str());
  EXPECT_NEAR(chain->face_mi.deviation_mm, kNoise_mm, 0.12);
  EXPECT_GT(chain->face_mi.at_teeth_mm, kLargestFaceScanError_mm);
  EXPECT_LT(off_mm, 3 * chain->face_mi.at_teeth_mm);
  ASSERT_EQ(chain->warnings.size(), 2u);
  EXPECT_EQ(chain->warnings[0].find("face scan in MI too coarse for T_F: deviation 0."), 0u)
      << chain->warnings[0];
  EXPECT_EQ(chain->warnings[1].find("face scan in TP too coarse for T_F"), 0u) << chain->warnings[1];
}

}  // namespace
}  // namespace gnathion
