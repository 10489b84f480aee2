#include "phantom/case.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/random.h"
#include "core/transform_io.h"
#include "phantom/case_scans.h"
#include "phantom/face.h"

namespace gnathion {
namespace {

using nlohmann::json;

template <class T>
json pose_json(const T& pose) {
  return {{"matrix", matrix_json(pose.rigid.matrix())}};
}

json point_json(const Vector3& p) {
  return {p.x(), p.y(), p.z()};
}

/// Names as in chain.json, plus what only the phantom knows.
json truth_json(const PhantomPatient& patient, const PhantomScanPoses& poses, std::uint64_t seed) {
  const PhantomTruth truth = phantom_truth(patient, poses);
  const PhantomLandmarks& at = patient.jaws.landmarks;
  return {
      {"seed", seed},
      {"unit", "mm"},
      {"bow_from_dental", pose_json(patient.bow_from_dental)},
      {"bow_from_face", pose_json(truth.bow_from_face)},
      {"dental_from_face", pose_json(truth.dental_from_face)},
      {"bow_motion", pose_json(truth.bow_motion)},
      {"therapeutic", pose_json(patient.therapeutic)},
      {"head_from_dental", pose_json(patient.head_from_dental)},
      {"camera_from_dental_at_rest", pose_json(phantom_camera_from_dental_at_rest())},
      {"face_mi_from_face_tp", pose_json(truth.face_mi_from_face_tp)},
      {"face_mi_from_dental", pose_json(poses.face_mi_from_dental)},
      {"face_tp_from_dental", pose_json(poses.face_tp_from_dental)},
      {"tp_scan_from_dental", pose_json(poses.tp_scan_from_dental)},
      {"clutch_scan_from_dental", pose_json(poses.clutch_scan_from_dental)},
      {"landmarks_mm",
       {{"upper_incisal_point", point_json(at.upper_incisal_point_mm)},
        {"lower_incisal_point", point_json(at.lower_incisal_point_mm)},
        {"molar_left", point_json(at.molar_left_mm)},
        {"molar_right", point_json(at.molar_right_mm)},
        {"condyle_left", point_json(at.condyle_left_mm)},
        {"condyle_right", point_json(at.condyle_right_mm)}}},
  };
}

std::string case_toml(std::uint64_t seed) {
  return fmt::format(
      R"(# A case of Gnathion: one patient, one session. Paths are relative to this file; meshes are in millimetres.
# This one was made by `gnathion phantom`; truth.json beside it holds every true pose.

[case]
id = "phantom-{}"
kind = "phantom"   # "phantom": synthetic, with ground truth; "patient": recorded
seed = {}          # of the phantom: the same number gives the same bytes

[scans]
maxilla_mi = "scans/maxilla_mi.ply"          # upper arch; its frame is the dental frame
mandible_mi = "scans/mandible_mi.ply"        # lower arch in maximal intercuspation, same frame
maxilla_tp = "scans/maxilla_tp.ply"          # upper arch once more, in the frame of the scans in TP
mandible_tp = "scans/mandible_tp.ply"        # lower arch in the therapeutic position, same frame as maxilla_tp
mandible_clutch = "scans/mandible_clutch.ply"  # lower arch with the bow's clutch on (for T_D), a frame of its own
face_mi = "scans/face_mi.ply"                # face, bow and head frame with the jaws in MI
face_tp = "scans/face_tp.ply"                # the same in TP, in a frame of its own

[bodies]
bow = "bodies/bow.stl"                # the mandibular bow as designed, in its CAD frame
head_frame = "bodies/head_frame.stl"  # the head frame, in its CAD frame

[session]
rig = "rig.toml"                  # cameras, and the tags of bow and head frame
recording = "recording.mcap"      # the jaw's movements as the cameras saw them

[truth]
poses = "truth.json"                       # only phantoms have it
maxilla = "truth/maxilla.ply"              # true surfaces, dental frame, MI
mandible_mi = "truth/mandible_mi.ply"
face = "truth/face.ply"
condyle_left = "truth/condyle_left.ply"
condyle_right = "truth/condyle_right.ply"
fossa_left = "truth/fossa_left.ply"
fossa_right = "truth/fossa_right.ply"
)",
      seed, seed);
}

Status make_directories(const std::filesystem::path& dir) {
  for (const char* name : {"scans", "bodies", "truth"}) {
    std::error_code error;
    std::filesystem::create_directories(dir / name, error);
    if (error)
      return fail(ErrorCode::kInternal, "cannot make directory", (dir / name).string(), error.message());
  }
  return {};
}

Status write_scans(const PhantomPatient& patient, const PhantomScanPoses& poses, std::uint64_t seed,
                   const std::filesystem::path& dir, Progress& progress) {
  double done = 0;
  for (const PhantomScanKind kind : kPhantomScans) {
    const TriangleMesh scan = simulate_phantom_scan(patient, poses, kind, seed);
    GNATHION_CHECK_OK(write_mesh(dir / (std::string(file_stem(kind)) + ".ply"), scan));
    progress.update(++done / static_cast<double>(kPhantomScans.size()));
  }
  return {};
}

Status write_truth_meshes(const PhantomPatient& patient, const std::filesystem::path& dir) {
  GNATHION_CHECK_OK(write_mesh(dir / "maxilla.ply", patient.jaws.maxilla));
  GNATHION_CHECK_OK(write_mesh(dir / "mandible_mi.ply", patient.jaws.mandible_mi));
  GNATHION_CHECK_OK(write_mesh(dir / "face.ply", patient.face));
  GNATHION_CHECK_OK(write_mesh(dir / "condyle_left.ply", patient.jaws.condyle_left));
  GNATHION_CHECK_OK(write_mesh(dir / "condyle_right.ply", patient.jaws.condyle_right));
  GNATHION_CHECK_OK(write_mesh(dir / "fossa_left.ply", patient.jaws.fossa_left));
  return write_mesh(dir / "fossa_right.ply", patient.jaws.fossa_right);
}

}  // namespace

Status write_phantom_case(const PhantomPatient& patient, std::uint64_t seed, const std::filesystem::path& dir,
                          Progress& progress) {
  progress.begin_step("simulating scans", 1.0);
  const PhantomScanPoses poses = phantom_scan_poses(seed);
  GNATHION_CHECK_OK(make_directories(dir));
  GNATHION_CHECK_OK(write_scans(patient, poses, seed, dir / "scans", progress));
  GNATHION_CHECK_OK(write_mesh(dir / "bodies" / "bow.stl", patient.bow.surface));
  GNATHION_CHECK_OK(write_mesh(dir / "bodies" / "head_frame.stl", patient.head_frame.surface));
  GNATHION_CHECK_OK(write_rig(dir / "rig.toml", phantom_rig(patient)));
  GNATHION_CHECK_OK(write_truth_meshes(patient, dir / "truth"));
  GNATHION_CHECK_OK(write_json(dir / "truth.json", truth_json(patient, poses, seed)));
  return write_file(dir / "case.toml", case_toml(seed));
}

}  // namespace gnathion
