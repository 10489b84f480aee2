#include "pipeline/demo.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "acquisition/recording.h"
#include "core/file.h"
#include "phantom/case.h"
#include "phantom/cbct.h"
#include "phantom/film.h"
#include "phantom/film_scene.h"
#include "pipeline/nested_progress.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

Status film_session(const PhantomPatient& patient, std::uint64_t seed, const fs::path& folder,
                    Progress& progress) {
  FilmOptions options;
  options.seed = seed;
  PhantomFilm film(film_scene(patient), options);
  std::map<std::string, std::string> attachments;
  for (const char* name : {"rig.toml", "bow.toml", "head_frame.toml"}) {
    GNATHION_TRY(attachments[name], read_file(folder / name));
  }
  return record(film, folder / "recording.mcap", attachments, film.frames_per_camera(), progress);
}

/// Largest difference of two maps over the mandible's crowns. For a map between frames the crowns are first
/// taken to its source by the true map.
MotionError error_at_teeth(const Rigid3& estimate, const Rigid3& truth, const PhantomJaws& jaws,
                           bool crowns_are_in_target) {
  MotionError e;
  const Rigid3 difference = estimate * truth.inverse();
  e.angle_deg = difference.angle_rad() * 180 / M_PI;
  for (std::size_t i = 0; i < jaws.mandible_mi.vertices_mm.size(); ++i) {
    if (jaws.mandible_fdi[i] == 0) continue;
    const Vector3& p = jaws.mandible_mi.vertices_mm[i];
    const Vector3 at = crowns_are_in_target ? p : truth * p;
    const double d = (difference * at - at).norm();
    if (d > e.largest_tooth_mm) e = {d, jaws.mandible_fdi[i], e.angle_deg};
  }
  return e;
}

json error_json(const MotionError& e) {
  return {{"largest_tooth_mm", e.largest_tooth_mm},
          {"worst_tooth_fdi", e.worst_tooth_fdi},
          {"angle_deg", e.angle_deg}};
}

}  // namespace

Result<PhantomPatient> make_phantom_case(std::uint64_t seed, const fs::path& folder, Progress& progress) {
  progress.begin_step("modelling the phantom patient", 0.05);
  PhantomPatient patient = make_phantom_patient(seed);
  {
    NestedProgress scanning(progress, "scanning teeth and face", 0.10);
    GNATHION_CHECK_OK(write_phantom_case(patient, seed, folder, scanning));
  }
  progress.begin_step("filming and recording the session", 0.20);
  GNATHION_CHECK_OK(film_session(patient, seed, folder, progress));
  return patient;
}

Status add_phantom_cbct(const PhantomPatient& patient, std::uint64_t seed, const fs::path& folder) {
  constexpr double kVoxelMm = 0.5;
  PhantomCbctOptions options;
  options.seed = seed;
  options.voxel_mm = kVoxelMm;
  options.blur_mm = 0.5 * kVoxelMm;
  const PhantomCbct cbct = make_phantom_cbct(patient.jaws, draw_face_shape(seed), options);
  GNATHION_CHECK_OK(write_phantom_nrrd(folder / "scans" / "cbct.nrrd", cbct));
  GNATHION_TRY(std::string toml, read_file(folder / "case.toml"));
  constexpr std::string_view kAfter = "[scans]\n";
  const std::size_t at = toml.find(kAfter);
  if (at == std::string::npos) return bad_input("cannot add CBCT", "case.toml", "no [scans]");
  toml.insert(at + kAfter.size(), "cbct = \"scans/cbct.nrrd\"                  # jaws in MI\n");
  return write_file(folder / "case.toml", toml);
}

Result<DemoResult> run_demo(std::uint64_t seed, const SplintParameters& parameters, const fs::path& folder,
                            Progress& progress, bool with_cbct) {
  GNATHION_TRY(const PhantomPatient patient, make_phantom_case(seed, folder, progress));
  if (with_cbct) GNATHION_CHECK_OK(add_phantom_cbct(patient, seed, folder));
  GNATHION_TRY(const CaseFile files, read_case(folder));
  RunOptions options;
  options.parameters = parameters;
  DemoResult demo;
  GNATHION_TRY(demo.results, run_case(files, options, progress));

  GNATHION_TRY(const json truth, read_json(files.truth));
  GNATHION_TRY(const Matrix4 t, matrix_from_json(truth["dental_from_face"]["matrix"], files.truth.string()));
  const CaseResults& r = demo.results;
  demo.dental_from_face =
      error_at_teeth(r.chain.dental_from_face.value, Rigid3::from_matrix(t), patient.jaws, true);
  const auto th_error = [&](const TherapeuticEstimate& e) {
    return error_at_teeth(e.therapeutic.value.rigid, patient.therapeutic.rigid, patient.jaws, false);
  };
  demo.camera = th_error(r.camera.estimate);
  demo.faces = th_error(*r.faces);
  demo.fused = th_error(r.therapeutic);
  GNATHION_CHECK_OK(write_json(folder / "results" / "accuracy.json", demo_json(demo)));
  return demo;
}

json demo_json(const DemoResult& demo) {
  json j = {{"error_against_truth",
             {{"dental_from_face", error_json(demo.dental_from_face)},
              {"therapeutic_camera", error_json(demo.camera)},
              {"therapeutic_faces", error_json(demo.faces)},
              {"therapeutic_fused", error_json(demo.fused)}}}};
  for (const char* key : {"verdict", "violated", "mesh", "thickness_mm", "maxilla_penetration_mm",
                          "mandible_penetration_mm", "timing_s", "peak_rss_mib"})
    if (demo.results.design.report->contains(key)) j["design"][key] = (*demo.results.design.report)[key];
  return j;
}

std::string demo_text(const DemoResult& demo, const fs::path& folder) {
  const auto line = [](const char* name, const MotionError& e) {
    return fmt::format("  {:<28} {:.3f} mm at tooth {}, {:.3f} deg\n", name, e.largest_tooth_mm,
                       e.worst_tooth_fdi, e.angle_deg);
  };
  return "Error against the phantom's truth, largest over all teeth:\n" +
         line("T (face scan to teeth)", demo.dental_from_face) + line("T_th by the camera", demo.camera) +
         line("T_th by the face scans", demo.faces) + line("T_th, both fused", demo.fused) +
         fmt::format("Splint: {}\n", (*demo.results.design.report)["verdict"].get<std::string>()) +
         fmt::format("Look at {}\n   or: gnathion-viewer {}\n", (folder / "results" / "report.html").string(),
                     folder.string());
}

}  // namespace gnathion
