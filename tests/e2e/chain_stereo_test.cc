// A chair without a face scanner: two cameras see head, head frame and bow under a dot pattern, in MI and in
// TP; their stereo surfaces are the chain's face scans.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "acquisition/scanner/stereo_surface.h"
#include "calibration/chain.h"
#include "calibration/composition.h"
#include "phantom/case.h"
#include "phantom/case_scans.h"
#include "phantom/patient.h"
#include "tests/support/speckled_face.h"

namespace gnathion {
namespace {

constexpr std::uint64_t kSeed = 31;

/// Cut until no edge is longer than the pattern's grain allows, with the pattern as colours.
void paint(const Vector3& a, const Vector3& b, const Vector3& c, std::uint64_t seed, TriangleMesh& out) {
  constexpr double kLongest_mm = 0.7;
  const double ab = (a - b).norm(), bc = (b - c).norm(), ca = (c - a).norm();
  const double longest = std::max({ab, bc, ca});
  if (longest > kLongest_mm) {
    if (longest == bc) return paint(b, c, a, seed, out);
    if (longest == ca) return paint(c, a, b, seed, out);
    const Vector3 middle = 0.5 * (a + b);
    paint(a, middle, c, seed, out);
    return paint(middle, b, c, seed, out);
  }
  const auto n = static_cast<std::uint32_t>(out.vertices_mm.size());
  for (const Vector3& p : {a, b, c}) {
    const auto grey =
        static_cast<std::uint8_t>(255 * std::clamp(0.5 + 1.3 * (speckle(p, 1.6, seed) - 0.5), 0.05, 1.0));
    out.vertices_mm.push_back(p);
    out.colors_rgb.push_back({grey, grey, grey});
  }
  out.triangles.push_back({n, n + 1, n + 2});
}

TriangleMesh painted(const TriangleMesh& mesh, std::uint64_t seed) {
  TriangleMesh out;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    paint(mesh.corner(t, 0), mesh.corner(t, 1), mesh.corner(t, 2), seed, out);
  return out;
}

struct Chair {
  PhantomPatient patient = make_phantom_patient(kSeed);
  TriangleMesh bow = painted(patient.bow.surface, 1), frame = painted(patient.head_frame.surface, 2),
               face = painted(patient.face, 3);
  StereoBench bench = stereo_bench(
      merged(patient.face, transformed(patient.bow_from_dental.rigid.inverse(), patient.bow.surface)), 450,
      120);

  /// The mandible moved by `mandible`, then the whole head by `head`.
  Result<StereoSurface> scan(const Rigid3& mandible, const Rigid3& head, std::uint64_t seed) const {
    const Rigid3 dental_from_bow = mandible * patient.bow_from_dental.rigid.inverse();
    const TriangleMesh all =
        transformed(head, merged(merged(face, transformed(dental_from_bow, bow)),
                                 transformed(patient.head_from_dental.rigid.inverse(), frame)));
    const Rigid3 second_from_dental = bench.second.rig_from_camera.inverse() * bench.first_from_dental;
    StereoOptions options;
    options.near_mm = 280;
    options.far_mm = 560;
    options.step_px = 1;
    return stereo_surface(photograph(all, bench.first.model, bench.first_from_dental, seed),
                          photograph(all, bench.second.model, second_from_dental, seed + 1), bench.first,
                          bench.second, options);
  }
};

TEST(StereoFaceScans, CarryTheChain) {
  const Chair chair;
  const PhantomPatient& patient = chair.patient;
  const PhantomScanPoses poses = phantom_scan_poses(kSeed);
  const Rigid3 head_moved = exp_se3((Vector6() << 0.02, -0.03, 0.01, 3, -2, 4).finished());
  const auto mi = chair.scan({}, {}, 41);
  const auto tp = chair.scan(patient.therapeutic.rigid, head_moved, 43);
  ASSERT_TRUE(mi) << mi.error().line();
  ASSERT_TRUE(tp) << tp.error().line();

  ChainScans scans;
  scans.mandible_mi = simulate_phantom_scan(patient, poses, PhantomScanKind::kMandibleMi, kSeed);
  scans.clutch_scans = {simulate_phantom_scan(patient, poses, PhantomScanKind::kMandibleClutch, kSeed)};
  scans.bow_model = patient.bow.surface;
  scans.head_frame_model = patient.head_frame.surface;
  scans.faces_mi = {mi->surface.mesh};
  scans.faces_tp = {tp->surface.mesh};
  SilentProgress silent;
  const auto chain = solve_chain(scans, {}, silent);
  ASSERT_TRUE(chain) << chain.error().line();

  const Rigid3 true_t_f = patient.bow_from_dental.rigid * chair.bench.first_from_dental.inverse();
  const Rigid3 error = chain->bow_from_face.value * true_t_f.inverse();
  const Motion<Dental> found = therapeutic_from_faces(*chain).therapeutic.value;
  double sum = 0, largest = 0;
  const std::vector<Vector3>& teeth = patient.jaws.mandible_mi.vertices_mm;
  for (const Vector3& p : teeth) {
    const Vector3 in_bow = patient.bow_from_dental.rigid * p;
    sum += (error * in_bow - in_bow).squaredNorm();
    largest = std::max(largest, (found.rigid * p - patient.therapeutic.rigid * p).norm());
  }
  const double t_f_mm = std::sqrt(sum / static_cast<double>(teeth.size()));
  printf(
      "deviation on the bow %.3f mm; T_F at the teeth: error %.3f mm, predicted %.3f mm; T_th off by %.3f "
      "mm\n",
      chain->face_mi.deviation_mm, t_f_mm, chain->face_mi.at_teeth_mm, largest);
  for (const std::string& w : chain->warnings) printf("%s\n", w.c_str());
  EXPECT_LT(chain->face_mi.deviation_mm, 0.2);
  EXPECT_LT(t_f_mm, 0.3);
  EXPECT_LT(t_f_mm, 4 * chain->face_mi.at_teeth_mm);
  EXPECT_LT(largest, 0.15);
}

}  // namespace
}  // namespace gnathion
