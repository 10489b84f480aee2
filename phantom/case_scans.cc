#include "phantom/case_scans.h"

#include <cmath>

#include "core/random.h"
#include "phantom/face.h"
#include "phantom/scanner.h"

namespace gnathion {
namespace {

constexpr double kScaleError = 0.0005;
constexpr double kSoftTissueShift_mm = 0.3;

Rigid3 arbitrary_pose(Random& random, double spread_mm) {
  const Matrix3 rotation = random.rotation();
  return {rotation, spread_mm * random.normal3()};
}

/// Scale errors have the full size; only their sign is drawn. Scans of one session (MI, TP, clutch, faces)
/// share it within, not between them.
double scale_error(std::uint64_t seed, std::uint64_t session) {
  Random random(seed, 0x5CA1E + session);
  return random.uniform() < 0.5 ? -kScaleError : kScaleError;
}

/// The bow at the lips as far as an intraoral scanner reaches: up to the feature block, not the carrier.
TriangleMesh within_reach(const TriangleMesh& bow_in_dental) {
  std::vector<bool> keep(bow_in_dental.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) {
    const Vector3 middle =
        (bow_in_dental.corner(t, 0) + bow_in_dental.corner(t, 1) + bow_in_dental.corner(t, 2)) / 3.0;
    keep[t] = middle.y() > -53 && std::abs(middle.x()) < 30;
  }
  return submesh(bow_in_dental, keep);
}

TriangleMesh bow_in_dental(const PhantomPatient& patient) {
  return transformed(patient.bow_from_dental.rigid.inverse(), patient.bow.surface);
}

/// Face, bow and head frame as the face scanner has them before it, in the Dental frame of the head.
TriangleMesh face_scene(const PhantomPatient& patient, const TriangleMesh& face,
                        const Motion<Dental>& mandible) {
  const TriangleMesh bow = transformed(mandible.rigid, bow_in_dental(patient));
  const TriangleMesh head_frame =
      transformed(patient.head_from_dental.rigid.inverse(), patient.head_frame.surface);
  return merged(merged(face, bow), head_frame);
}

TriangleMesh scan_arch(const TriangleMesh& arch, const Vector3& occlusal, double scale,
                       const Rigid3& scan_from_dental, Random& random) {
  ScannerModel model = intraoral_scanner(occlusal);
  model.scale_error = scale;
  model.scale_centre_mm = Vector3::Zero();  // both arches of one session stretch from one point
  return simulate_scan(arch, model, scan_from_dental, random);
}

TriangleMesh scan_clutch(const PhantomPatient& patient, double scale, const Rigid3& scan_from_dental,
                         Random& random) {
  ScannerModel model = intraoral_scanner(Vector3::UnitZ());
  model.scale_error = scale;
  // The wand also goes around the stem, below it too.
  for (const double sideways : {-0.8, 0.0, 0.8})
    model.views.push_back(Vector3(sideways, -0.4, -1).normalized());
  return simulate_scan(merged(patient.jaws.mandible_mi, within_reach(bow_in_dental(patient))), model,
                       scan_from_dental, random);
}

TriangleMesh scan_face(const TriangleMesh& scene, double scale, const Rigid3& scan_from_dental,
                       Random& random) {
  ScannerModel model = face_scanner(-Vector3::UnitY(), Vector3::UnitZ());
  model.scale_error = scale;
  return simulate_scan(scene, model, scan_from_dental, random);
}

}  // namespace

PhantomScanPoses phantom_scan_poses(std::uint64_t seed) {
  Random random(seed, 0x5CA25);
  PhantomScanPoses poses;
  poses.tp_scan_from_dental.rigid = arbitrary_pose(random, 30);
  poses.clutch_scan_from_dental.rigid = arbitrary_pose(random, 30);
  poses.face_mi_from_dental.rigid = arbitrary_pose(random, 200);
  poses.face_tp_from_dental.rigid = arbitrary_pose(random, 200);
  return poses;
}

const char* file_stem(PhantomScanKind kind) {
  switch (kind) {
    case PhantomScanKind::kMaxillaMi:
      return "maxilla_mi";
    case PhantomScanKind::kMandibleMi:
      return "mandible_mi";
    case PhantomScanKind::kMaxillaTp:
      return "maxilla_tp";
    case PhantomScanKind::kMandibleTp:
      return "mandible_tp";
    case PhantomScanKind::kMandibleClutch:
      return "mandible_clutch";
    case PhantomScanKind::kFaceMi:
      return "face_mi";
    case PhantomScanKind::kFaceTp:
      return "face_tp";
  }
  return "";
}

TriangleMesh simulate_phantom_scan(const PhantomPatient& patient, const PhantomScanPoses& poses,
                                   PhantomScanKind kind, std::uint64_t seed,
                                   std::optional<std::uint64_t> scanner_seed) {
  const std::uint64_t scanner = scanner_seed.value_or(seed);
  Random random(seed, 0x5CA0 + static_cast<std::uint64_t>(kind));
  const Vector3 up = Vector3::UnitZ();
  const PhantomJaws& jaws = patient.jaws;
  switch (kind) {
    case PhantomScanKind::kMaxillaMi:
      return scan_arch(jaws.maxilla, -up, scale_error(scanner, 0), {}, random);
    case PhantomScanKind::kMandibleMi:
      return scan_arch(jaws.mandible_mi, up, scale_error(scanner, 0), {}, random);
    case PhantomScanKind::kMaxillaTp:
      return scan_arch(jaws.maxilla, -up, scale_error(scanner, 1), poses.tp_scan_from_dental.rigid, random);
    case PhantomScanKind::kMandibleTp:
      return scan_arch(transformed(patient.therapeutic.rigid, jaws.mandible_mi), up, scale_error(scanner, 1),
                       poses.tp_scan_from_dental.rigid, random);
    case PhantomScanKind::kMandibleClutch:
      return scan_clutch(patient, scale_error(scanner, 2), poses.clutch_scan_from_dental.rigid, random);
    case PhantomScanKind::kFaceMi:
      return scan_face(face_scene(patient, patient.face, {}), scale_error(scanner, 3),
                       poses.face_mi_from_dental.rigid, random);
    case PhantomScanKind::kFaceTp:
      return scan_face(face_scene(patient, with_soft_tissue_shift(patient.face, kSoftTissueShift_mm, seed),
                                  patient.therapeutic),
                       scale_error(scanner, 3), poses.face_tp_from_dental.rigid, random);
  }
  return {};
}

PhantomTruth phantom_truth(const PhantomPatient& patient, const PhantomScanPoses& poses) {
  PhantomTruth truth;
  truth.dental_from_face = poses.face_mi_from_dental.inverse();
  truth.bow_from_face = patient.bow_from_dental * truth.dental_from_face;
  truth.face_mi_from_face_tp = poses.face_mi_from_dental * poses.face_tp_from_dental.inverse();
  const Transform<Dental, Dental> mandible_in_tp(patient.therapeutic.rigid);
  truth.face_tp_from_bow = poses.face_tp_from_dental * mandible_in_tp * patient.bow_from_dental.inverse();
  // The bow seen in TP, brought into the frame at MI by the head: where it was at MI is bow_from_face.
  const Transform<FaceScanMi, Bow> bow_at_tp = truth.face_mi_from_face_tp * truth.face_tp_from_bow;
  truth.bow_motion = Motion<FaceScanMi>(bow_at_tp.rigid * truth.bow_from_face.rigid);
  return truth;
}

}  // namespace gnathion
