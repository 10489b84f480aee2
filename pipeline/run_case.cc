#include "pipeline/run_case.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "acquisition/pose_recording.h"
#include "calibration/frames_graph_json.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "pipeline/displacement_steps.h"
#include "pipeline/frames_steps.h"
#include "pipeline/nested_progress.h"
#include "pipeline/pictures.h"
#include "pipeline/report.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

Status need(const fs::path& path, const CaseFile& files, const char* role) {
  if (path.empty())
    return bad_input("cannot run case", files.toml().string(), fmt::format("'{}' is missing", role));
  return {};
}

Status track_session_of(const CaseFile& files, const fs::path& out, CaseResults& r, Progress& progress) {
  GNATHION_CHECK_OK(need(files.rig, files, "rig"));
  GNATHION_CHECK_OK(need(files.recording, files, "recording"));
  GNATHION_TRY(const Rig rig, read_rig(files.rig));
  progress.begin_step("replaying and tracking the recording", 0.25);
  GNATHION_TRY(r.session, track_recording(files.recording, rig, progress));
  GNATHION_TRY(const std::string rig_text, read_file(files.rig));
  return write_poses(out / "motion.mcap", to_pose_recording(r.session), {{"rig.toml", rig_text}});
}

Status solve_chain_of(const CaseFile& files, const fs::path& out, CaseResults& r, Progress& progress) {
  GNATHION_CHECK_OK(need(files.mandible_clutch, files, "mandible_clutch"));
  GNATHION_CHECK_OK(need(files.bow_model, files, "bow"));
  NestedProgress solving(progress, "registering scans, solving the chain", 0.25);
  ChainFiles chain_files{
      files.mandible_mi, files.bow_model, files.head_frame_model, {files.mandible_clutch}, {}, {}};
  if (!files.face_mi.empty()) chain_files.faces_mi = {files.face_mi};
  if (!files.face_tp.empty()) chain_files.faces_tp = {files.face_tp};
  GNATHION_TRY(const ChainScans scans, read_chain_scans(chain_files));
  GNATHION_TRY(r.chain, solve_chain(scans, {}, solving));
  return write_json(out / "chain.json", chain_json(r.chain));
}

/// Displacements with their bounds, the screw axis, the error map.
Status tell_displacement(const CaseFile& files, const fs::path& out, CaseResults& r) {
  GNATHION_TRY(const TriangleMesh maxilla, read_jaw(files.maxilla_mi));
  GNATHION_TRY(const TriangleMesh mandible, read_jaw(files.mandible_mi));
  GNATHION_TRY(const MandibleLandmarks points, mandible_landmarks(maxilla, mandible));
  const Uncertain<Motion<Dental>>& th = r.therapeutic.therapeutic;
  r.landmark_names = points.names;
  r.landmarks = displacement_bounds(th, points.points_mm);
  r.screw = screw_axis(th, points.arch_centroid_mm);
  GNATHION_CHECK_OK(
      write_json(out / "displacement.json", displacement_json(th.value, th.covariance, points)));
  return write_error_map(th, mandible, points.arch, out);
}

/// All registrations of the case in one graph, its loops checked.
Status write_frames(const CaseFile& files, const fs::path& out, CaseResults& r) {
  GNATHION_TRY(const FramesGraph graph, frames_of_run(files, r, r.frame_notes));
  for (const FrameSuspect& s : graph.suspects(graph.loops()))
    r.frame_notes.push_back(
        fmt::format("{}inconsistent: {}", s.certain ? "" : "perhaps ", graph.edges()[s.edge].name()));
  return write_json(out / "frames.json", frames_json(graph));
}

json estimate_json(const TherapeuticEstimate& e, const json& source) {
  return motion_json(e.therapeutic.value, e.therapeutic.covariance, source);
}

/// Both routes, compared and fused; with one route alone, that one.
Status find_therapeutic(const CaseFile& files, const RunOptions& options, const fs::path& out,
                        CaseResults& r) {
  GNATHION_TRY(r.camera, camera_route(r.session, r.chain.bow_from_dental, {}));
  if (!r.camera.positions.closes() && !options.accept_slip)
    return fail(ErrorCode::kGate, "MI does not close", files.recording.string(),
                closure_text(r.camera) + "; --accept-slip goes on");
  GNATHION_CHECK_OK(
      write_json(out / "T_th_camera.json", estimate_json(r.camera.estimate, camera_route_source(r.camera))));
  r.therapeutic = r.camera.estimate;
  json source = {{"routes", {"camera"}}};
  if (r.chain.has_faces) {
    r.faces = therapeutic_from_faces(r.chain);
    GNATHION_CHECK_OK(
        write_json(out / "T_th_faces.json", estimate_json(*r.faces, {{"route", "face scans"}})));
    const Matrix6& shared = r.chain.bow_from_dental.covariance;
    GNATHION_TRY(const TriangleMesh mandible, read_jaw(files.mandible_mi));
    r.comparison = compare_routes(r.camera.estimate, *r.faces, shared, mandible.vertices_mm);
    // Routes that contradict each other must not sharpen each other: the camera's stands alone then.
    if (r.comparison->consistent) r.therapeutic = fuse_routes(r.camera.estimate, *r.faces, shared);
    source = {{"routes", r.comparison->consistent ? json{"camera", "face scans"} : json{"camera"}},
              {"comparison",
               {{"largest_mm", r.comparison->largest_mm},
                {"angle_deg", r.comparison->angle_deg},
                {"mahalanobis", r.comparison->mahalanobis},
                {"p_value", r.comparison->chi2_p_value},
                {"consistent", r.comparison->consistent}}}};
  }
  return write_json(out / "T_th.json", estimate_json(r.therapeutic, source));
}

Status write_jaw_motion(const fs::path& out, CaseResults& r) {
  r.jaw_motion = jaw_motion(r.session, r.camera.positions.head_from_bow_mi.value, r.chain.t_d(),
                            r.landmarks.front().at_mm);
  return write_motion_csv(out / "motion.csv", r.jaw_motion);
}

Status design_of(const CaseFile& files, const RunOptions& options, const fs::path& out, CaseResults& r,
                 Progress& progress) {
  NestedProgress designing(progress, "checking, designing, verifying", 0.35);
  DesignJob job;
  job.maxilla = files.maxilla_mi;
  job.mandible = files.mandible_mi;
  job.shown_transform = "results/T_th.json";
  job.shown_folder = files.folder;
  job.transform = out / "T_th.json";
  job.parameters = options.parameters;
  job.edits = options.edits;
  GNATHION_TRY(r.design, run_design(job, out, designing));
  return {};
}

}  // namespace

Result<CaseResults> run_case(const CaseFile& files, const RunOptions& options, Progress& progress) {
  GNATHION_TRY(StagedDirectory results, StagedDirectory::create(files.folder / "results", options.force));
  const fs::path out = results.path();
  CaseResults r;
  GNATHION_CHECK_OK(track_session_of(files, out, r, progress));
  GNATHION_CHECK_OK(solve_chain_of(files, out, r, progress));
  progress.begin_step("T_th by both routes", 0.05);
  GNATHION_CHECK_OK(find_therapeutic(files, options, out, r));
  GNATHION_CHECK_OK(tell_displacement(files, out, r));
  GNATHION_CHECK_OK(write_frames(files, out, r));
  GNATHION_CHECK_OK(write_jaw_motion(out, r));
  GNATHION_CHECK_OK(design_of(files, options, out, r, progress));
  progress.begin_step("drawing the report", 0.10);
  GNATHION_CHECK_OK(
      draw_jaw_path(r.jaw_motion, r.landmarks.front().at_mm, r.design.feasibility.arch, out / "pictures"));
  GNATHION_CHECK_OK(write_report(r, out));
  GNATHION_CHECK_OK(results.commit());
  return r;
}

}  // namespace gnathion
