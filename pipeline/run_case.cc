#include "pipeline/run_case.h"

#include <fmt/format.h>

#include <limits>
#include <nlohmann/json.hpp>

#include "acquisition/pose_recording.h"
#include "calibration/frames_graph_json.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "pipeline/design_job.h"
#include "pipeline/displacement_steps.h"
#include "pipeline/frames_steps.h"
#include "pipeline/nested_progress.h"
#include "pipeline/pictures.h"
#include "pipeline/report.h"
#include "pipeline/run_case_record.h"
#include "pipeline/virtual_patient.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

/// One run: the case, what it found so far, and the steps' keeper.
struct Run {
  const CaseFile& files;
  const RunOptions& options;
  CaseSteps steps;
  Progress& progress;
  CaseResults r;
  std::optional<MandibleLandmarks> points;
  std::optional<VirtualPatient> cbct;  ///< where the case has a volume, or joints as meshes
};

Status need(const fs::path& path, const CaseFile& files, const char* role) {
  if (path.empty())
    return bad_input("cannot run case", files.toml().string(), fmt::format("'{}' is missing", role));
  return {};
}

Result<PositionRoute> route_of(const CaseFile& files) {
  if (!files.transform.empty()) return PositionRoute::kGiven;
  if (!files.recording.empty()) return PositionRoute::kMeasured;
  if (!files.maxilla_tp.empty() && !files.mandible_tp.empty()) return PositionRoute::kScans;
  return bad_input("cannot run case", files.toml().string(),
                   "'recording' is missing; scans in TP or [position] transform would do as well");
}

/// What is read back is what goes on: a run that was killed and one that was not see the same numbers.
Status track(Run& run) {
  const CaseFile& files = run.files;
  GNATHION_CHECK_OK(need(files.rig, files, "rig"));
  GNATHION_TRY(const std::vector<StepInput> bodies, rig_inputs(files.rig));
  GNATHION_CHECK_OK(run.steps.know(files.rig));
  for (const StepInput& body : bodies) GNATHION_CHECK_OK(run.steps.know(body.path));
  GNATHION_TRY(const Rig rig, read_rig(files.rig));
  StepSpec spec{"track", 1, {{"session.recording", files.recording}, {"session.rig", files.rig}}, {}, "{}"};
  spec.inputs.insert(spec.inputs.end(), bodies.begin(), bodies.end());
  run.progress.begin_step("replaying and tracking the recording", 0.25);
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord& record) -> Status {
    GNATHION_TRY(const SessionMotion session, track_recording(files.recording, rig, run.progress));
    record.facts = tracking_facts(session);
    GNATHION_TRY(const std::string rig_text, read_file(files.rig));
    GNATHION_CHECK_OK(write_poses(to / "motion.mcap", to_pose_recording(session),
                                  {{"rig.toml", rig_text}, {"provenance.json", step_json(record).dump(2)}}));
    return write_json(to / "tracking.json", tracking_json(session));
  }));
  GNATHION_TRY(const PoseRecording poses, read_poses(out / "motion.mcap"));
  GNATHION_TRY(run.r.session, to_session_motion(poses, (out / "motion.mcap").string()));
  return read_tracking(out / "tracking.json", run.r.session);
}

Status chain(Run& run) {
  const CaseFile& files = run.files;
  NestedProgress solving(run.progress, "registering scans, solving the chain", 0.25);
  StepSpec spec{"chain", 1, {}, {}, "{}"};
  ChainFiles chain_files{
      files.mandible_mi, files.bow_model, files.head_frame_model, {files.mandible_clutch}, {}, {}};
  if (!files.chain.empty()) {
    spec.inputs = {{"calibrations.chain", files.chain}};
  } else {
    GNATHION_CHECK_OK(need(files.mandible_clutch, files, "mandible_clutch"));
    GNATHION_CHECK_OK(need(files.bow_model, files, "bow"));
    if (!files.face_mi.empty()) chain_files.faces_mi = {files.face_mi};
    if (!files.face_tp.empty()) chain_files.faces_tp = {files.face_tp};
    spec.inputs = {{"scans.mandible_mi", files.mandible_mi}, {"scans.mandible_clutch", files.mandible_clutch},
                   {"bodies.bow", files.bow_model},          {"bodies.head_frame", files.head_frame_model},
                   {"scans.face_mi", files.face_mi},         {"scans.face_tp", files.face_tp}};
  }
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord&) -> Status {
    if (!files.chain.empty()) {
      GNATHION_TRY(const json given, read_json(files.chain));
      return write_json(to / "chain.json", given);
    }
    GNATHION_TRY(const ChainScans scans, read_chain_scans(chain_files));
    GNATHION_TRY(const Chain solved, solve_chain(scans, {}, solving));
    return write_json(to / "chain.json", chain_json(solved));
  }));
  GNATHION_TRY(const json j, read_json(out / "chain.json"));
  GNATHION_TRY(run.r.chain, chain_from_json(j, (out / "chain.json").string()));
  return {};
}

/// Both routes, compared and fused; with one route alone, that one.
Result<json> measured_position(Run& run, const TriangleMesh& mandible) {
  CaseResults& r = run.r;
  GNATHION_TRY(r.camera, camera_route(r.session, r.chain.bow_from_dental, {}));
  if (!r.camera.positions.closes() && !run.options.accept_slip)
    return fail(ErrorCode::kGate, "MI does not close", run.files.recording.string(),
                closure_text(r.camera) + "; --accept-slip goes on");
  r.therapeutic = r.camera.estimate;
  if (!r.chain.has_faces) return json{{"routes", {"camera"}}};
  r.faces = therapeutic_from_faces(r.chain);
  const Matrix6& shared = r.chain.bow_from_dental.covariance;
  r.comparison = compare_routes(r.camera.estimate, *r.faces, shared, mandible.vertices_mm);
  // Routes that contradict each other must not sharpen each other: the camera's stands alone then.
  if (r.comparison->consistent) r.therapeutic = fuse_routes(r.camera.estimate, *r.faces, shared);
  return json{{"routes", r.comparison->consistent ? json{"camera", "face scans"} : json{"camera"}},
              {"comparison",
               {{"largest_mm", r.comparison->largest_mm},
                {"angle_deg", r.comparison->angle_deg},
                {"mahalanobis", r.comparison->mahalanobis},
                {"p_value", r.comparison->chi2_p_value},
                {"consistent", r.comparison->consistent}}}};
}

json estimate_json(const TherapeuticEstimate& e, const json& source) {
  return motion_json(e.therapeutic.value, e.therapeutic.covariance, source);
}

Status measure(Run& run, const TriangleMesh& mandible) {
  CaseResults& r = run.r;
  GNATHION_TRY(const json source, measured_position(run, mandible));
  const StepSpec spec{"position",
                      1,
                      {{"scans.mandible_mi", run.files.mandible_mi}},
                      {{"track", "motion.mcap"}, {"chain", "chain.json"}},
                      json{{"accept_slip", run.options.accept_slip}}.dump()};
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord&) -> Status {
    GNATHION_CHECK_OK(
        write_json(to / "T_th_camera.json", estimate_json(r.camera.estimate, camera_route_source(r.camera))));
    if (r.faces)
      GNATHION_CHECK_OK(
          write_json(to / "T_th_faces.json", estimate_json(*r.faces, {{"route", "face scans"}})));
    return write_json(to / "T_th.json", estimate_json(r.therapeutic, source));
  }));
  return {};
}

Status take_scans(Run& run) {
  const CaseFile& files = run.files;
  NestedProgress registering(run.progress, "registering the scans in TP", 0.25);
  const StepSpec spec{"position",
                      1,
                      {{"scans.maxilla_mi", files.maxilla_mi},
                       {"scans.mandible_mi", files.mandible_mi},
                       {"scans.maxilla_tp", files.maxilla_tp},
                       {"scans.mandible_tp", files.mandible_tp}},
                      {},
                      R"({"route":"intraoral scans"})"};
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord&) -> Status {
    GNATHION_TRY(const TriangleMesh maxilla_mi, read_jaw(files.maxilla_mi));
    GNATHION_TRY(const TriangleMesh mandible_mi, read_jaw(files.mandible_mi));
    GNATHION_TRY(const TriangleMesh maxilla_tp, read_jaw(files.maxilla_tp));
    GNATHION_TRY(const TriangleMesh mandible_tp, read_jaw(files.mandible_tp));
    GNATHION_TRY(const TwoScanResult two,
                 therapeutic_from_scans(maxilla_mi, mandible_mi, maxilla_tp, mandible_tp, {}, registering));
    return write_json(to / "T_th.json", motion_json(two.therapeutic.value, two.therapeutic.covariance,
                                                    {{"route", "intraoral scans"},
                                                     {"maxilla", pose_json(two.dental_from_intraoral_tp)},
                                                     {"mandible", pose_json(two.mandible)}}));
  }));
  return read_position(out / "T_th.json", run.r);
}

Status take_given(Run& run) {
  const StepSpec spec{
      "position", 1, {{"position.transform", run.files.transform}}, {}, R"({"route":"given"})"};
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord&) -> Status {
    GNATHION_TRY(const MotionFile given, read_motion(run.files.transform));
    return write_json(to / "T_th.json", motion_json(given.motion, given.covariance,
                                                    {{"route", "given"}, {"kind", given.kind}}));
  }));
  return read_position(out / "T_th.json", run.r);
}

Status find_position(Run& run, const TriangleMesh& mandible) {
  if (run.r.route == PositionRoute::kMeasured) {
    GNATHION_CHECK_OK(track(run));
    GNATHION_CHECK_OK(chain(run));
    run.progress.begin_step("T_th by both routes", 0.05);
    return measure(run, mandible);
  }
  return run.r.route == PositionRoute::kGiven ? take_given(run) : take_scans(run);
}

/// Displacements with their bounds, the screw axis, the error map.
Status tell_displacement(Run& run, const TriangleMesh& maxilla, const TriangleMesh& mandible) {
  CaseResults& r = run.r;
  GNATHION_TRY(run.points, mandible_landmarks(maxilla, mandible));
  const MandibleLandmarks& points = *run.points;
  const Uncertain<Motion<Dental>>& th = r.therapeutic.therapeutic;
  r.landmark_names = points.names;
  r.landmarks = displacement_bounds(th, points.points_mm);
  if (!r.covariance_known)
    for (LandmarkDisplacement& l : r.landmarks) l.bound95_mm = std::numeric_limits<double>::quiet_NaN();
  r.screw = screw_axis(th, points.arch_centroid_mm);
  const StepSpec spec{
      "displacement",
      1,
      {{"scans.maxilla_mi", run.files.maxilla_mi}, {"scans.mandible_mi", run.files.mandible_mi}},
      {{"position", "T_th.json"}},
      "{}"};
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord&) -> Status {
    const auto covariance = r.covariance_known ? std::optional<Matrix6>(th.covariance) : std::nullopt;
    GNATHION_CHECK_OK(write_json(to / "displacement.json", displacement_json(th.value, covariance, points)));
    return covariance ? write_error_map(th, mandible, points.arch, to) : Status();
  }));
  return {};
}

/// The case's CBCT in the dental frame, and its joints.
Status look_into_cbct(Run& run) {
  const CaseFile& files = run.files;
  if (files.cbct.empty()) return {};
  NestedProgress looking(run.progress, "the volume in the dental frame, its joints", 0.15);
  const StepSpec spec{"cbct",
                      1,
                      {{"scans.cbct", files.cbct},
                       {"scans.maxilla_mi", files.maxilla_mi},
                       {"scans.mandible_mi", files.mandible_mi},
                       {"scans.face_mi", files.face_mi}},
                      {},
                      "{}"};
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord&) {
    return write_virtual_patient(files, to, looking);
  }));
  GNATHION_TRY(run.cbct, read_virtual_patient(out));
  return {};
}

/// All registrations of the case in one graph, its loops checked.
Status tell_frames(Run& run) {
  GNATHION_TRY(StepSpec spec, frames_spec(run.files, run.r.route == PositionRoute::kMeasured));
  if (run.cbct) spec.uses.emplace_back("cbct", "cbct.json");
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord&) -> Status {
    std::vector<std::string> notes;
    GNATHION_TRY(const FramesGraph graph, frames_of_run(run.files, run.r, notes));
    for (const FrameSuspect& s : graph.suspects(graph.loops()))
      notes.push_back(
          fmt::format("{}inconsistent: {}", s.certain ? "" : "perhaps ", graph.edges()[s.edge].name()));
    json j = frames_json(graph);
    j["notes"] = notes;
    return write_json(to / "frames.json", j);
  }));
  GNATHION_TRY(const json j, read_json(out / "frames.json"));
  for (const json& note : j.at("notes")) run.r.frame_notes.push_back(note.get<std::string>());
  return {};
}

Status tell_jaw_motion(Run& run) {
  CaseResults& r = run.r;
  r.jaw_motion = jaw_motion(r.session, r.camera.positions.head_from_bow_mi.value, r.chain.t_d(),
                            r.landmarks.front().at_mm);
  const StepSpec spec{"jaw_motion",
                      1,
                      {},
                      {{"track", "motion.mcap"},
                       {"chain", "chain.json"},
                       {"position", "T_th.json"},
                       {"displacement", "displacement.json"}},
                      "{}"};
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord&) -> Status {
    GNATHION_CHECK_OK(write_motion_csv(to / "motion.csv", r.jaw_motion));
    std::error_code ec;
    fs::create_directory(to / "pictures", ec);
    return draw_jaw_path(r.jaw_motion, r.landmarks.front().at_mm, run.points->arch, to / "pictures");
  }));
  return {};
}

/// T_th is checked with the joints and the recorded motion where the case has them.
void add_known(const Run& run, DesignJob& job) {
  const fs::path steps = run.files.folder / ".steps";
  if (run.cbct && run.cbct->has_joints) job.known.cbct = steps / "cbct" / "joints";
  if (run.cbct) job.known_notes = run.cbct->notes;
  if (run.r.route == PositionRoute::kMeasured) job.known.motion = steps / "jaw_motion" / "motion.csv";
  if (job.known.motion.empty()) job.known.motion = run.files.motion;
}

Status design(Run& run) {
  NestedProgress designing(run.progress, "checking, designing, verifying", 0.35);
  const fs::path transform = run.files.folder / ".steps" / "position" / "T_th.json";
  StepSpec spec{"design",
                1,
                {{"scans.maxilla_mi", run.files.maxilla_mi},
                 {"scans.mandible_mi", run.files.mandible_mi},
                 {"scans.occlusal_surface", run.files.occlusal_surface},
                 {"session.motion", run.files.motion}},
                {{"position", "T_th.json"}},
                ""};
  if (run.cbct) spec.uses.emplace_back("cbct", "cbct.json");
  if (run.r.route == PositionRoute::kMeasured) spec.uses.emplace_back("jaw_motion", "motion.csv");
  json parameters = parameters_json(run.options.parameters);
  if (!run.options.edits.empty()) parameters["edits"] = edits_json(run.options.edits);
  spec.parameters = parameters.dump();
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord&) -> Status {
    DesignJob job;
    job.maxilla = run.files.maxilla_mi;
    job.mandible = run.files.mandible_mi;
    job.occlusal_surface = run.files.occlusal_surface;
    job.shown_transform = "results/T_th.json";
    job.shown_folder = run.files.folder;
    job.transform = transform;
    job.parameters = run.options.parameters;
    job.edits = run.options.edits;
    add_known(run, job);
    GNATHION_TRY(const DesignOutcome made, run_design(job, to, designing));
    return {};
  }));
  GNATHION_TRY(json report, read_json(out / "design.json"));
  GNATHION_TRY(json feasibility, read_json(out / "feasibility.json"));
  run.r.design = {std::make_shared<const json>(std::move(report)),
                  std::make_shared<const json>(std::move(feasibility))};
  return {};
}

Status report(Run& run) {
  run.progress.begin_step("drawing the report", 0.10);
  const fs::path steps = run.files.folder / ".steps";
  StepSpec spec{"report",
                1,
                {},
                {{"position", "T_th.json"}, {"displacement", "displacement.json"}, {"design", "design.json"}},
                json{{"case", run.r.case_id}}.dump()};
  if (run.r.route == PositionRoute::kMeasured || run.cbct) spec.uses.emplace_back("frames", "frames.json");
  if (run.r.route == PositionRoute::kMeasured)
    spec.uses.insert(spec.uses.end(),
                     {{"track", "tracking.json"}, {"chain", "chain.json"}, {"jaw_motion", "motion.csv"}});
  GNATHION_TRY(const fs::path out, run.steps.run(spec, [&](const fs::path& to, StepRecord& record) -> Status {
    return write_report(run.r, {steps / "design", steps / "displacement", steps / "jaw_motion"}, record, to);
  }));
  return {};
}

}  // namespace

Result<CaseResults> run_case(const CaseFile& files, const RunOptions& options, Progress& progress) {
  SystemClock system;
  GNATHION_TRY(const PositionRoute route, route_of(files));
  GNATHION_TRY(CaseSteps steps, CaseSteps::open(files.folder, files.id, options.force,
                                                options.clock != nullptr ? *options.clock : system));
  Run run{files, options, std::move(steps), progress, {}, {}, {}};
  run.r.case_id = files.id;
  run.r.route = route;
  for (const fs::path& scan : {files.maxilla_mi, files.mandible_mi}) GNATHION_CHECK_OK(run.steps.know(scan));
  GNATHION_TRY(const TriangleMesh maxilla, read_jaw(files.maxilla_mi));
  GNATHION_TRY(const TriangleMesh mandible, read_jaw(files.mandible_mi));
  GNATHION_CHECK_OK(find_position(run, mandible));
  GNATHION_CHECK_OK(tell_displacement(run, maxilla, mandible));
  GNATHION_CHECK_OK(look_into_cbct(run));
  if (route == PositionRoute::kMeasured || run.cbct) GNATHION_CHECK_OK(tell_frames(run));
  if (route == PositionRoute::kMeasured) GNATHION_CHECK_OK(tell_jaw_motion(run));
  GNATHION_CHECK_OK(design(run));
  GNATHION_CHECK_OK(report(run));
  GNATHION_CHECK_OK(run.steps.publish());
  run.r.steps = run.steps.outcomes();
  return std::move(run.r);
}

}  // namespace gnathion
