#include "viewer/model/case_content.h"

#include <chrono>
#include <future>

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "acquisition/pose_recording.h"
#include "calibration/frames_graph_json.h"
#include "core/mesh_io.h"
#include "pipeline/frames_steps.h"
#include "pipeline/motion_steps.h"
#include "pipeline/toml_file.h"
#include "viewer/model/daemon_requests.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

bool is_there(const fs::path& path) {
  std::error_code ec;
  return !path.empty() && fs::exists(path, ec);
}

/// A surface of the case: where it is, which step misses it, and how to get it.
struct Wanted {
  const char* role;
  Step step;
  const char* shown;
  const char* remedy;
  fs::path path;
  bool required;
};

/// The paths of a case.toml that the strict reader refuses: what it names is taken if it is there.
void read_leniently(CaseContent& c) {
  CaseFile& f = c.files;
  f.folder = c.folder;
  const Result<toml::table> t = read_toml(f.toml(), "cannot read case");
  if (!t) return;
  const auto take = [&](const char* section, const char* key, fs::path& into) {
    if (const auto value = (*t)[section][key].value<std::string>()) into = c.folder / *value;
  };
  take("scans", "maxilla_mi", f.maxilla_mi);
  take("scans", "mandible_mi", f.mandible_mi);
  take("scans", "mandible_clutch", f.mandible_clutch);
  take("scans", "face_mi", f.face_mi);
  take("scans", "face_tp", f.face_tp);
  take("bodies", "bow", f.bow_model);
  take("bodies", "head_frame", f.head_frame_model);
  take("session", "rig", f.rig);
  take("session", "recording", f.recording);
  if (Result<SplintParameters> p = read_parameters(f.toml())) f.parameters = *p;
}

void read_case_file(CaseContent& c) {
  if (Result<CaseFile> files = read_case(c.folder)) {
    c.files = std::move(*files);
  } else {
    read_leniently(c);
    if (is_there(c.folder / "case.toml"))
      c.absences.push_back({Step::kCapture, "case.toml", files.error().why, true});
    else
      c.absences.push_back({Step::kCapture, "case.toml",
                            "there is none; 'gnathion case import SCANS CASE' makes a case", false});
  }
  c.kind = c.files.kind.empty() ? "patient" : c.files.kind;
}

/// The phantom's own condyles and fossae, named in [truth]; a patient's come from the CBCT.
void add_truth(const CaseContent& c, std::vector<Wanted>& wanted) {
  const Result<toml::table> t = read_toml(c.files.toml(), "cannot read case");
  if (!t) return;
  for (const char* role : {"condyle_left", "condyle_right", "fossa_left", "fossa_right", "face"})
    if (const auto value = (*t)["truth"][role].value<std::string>())
      wanted.push_back(
          {role, Step::kTransformation, role, "[truth] of case.toml names it", c.folder / *value, false});
}

std::vector<Wanted> wanted_surfaces(const CaseContent& c) {
  const fs::path r = c.results();
  const fs::path splint = is_there(r / "splint.stl") ? r / "splint.stl" : r / "splint.rejected.stl";
  std::vector<Wanted> wanted = {
      {"maxilla_mi", Step::kCapture, "Upper scan", "name it in [scans] of case.toml", c.files.maxilla_mi,
       true},
      {"mandible_mi", Step::kCapture, "Lower scan", "name it in [scans] of case.toml", c.files.mandible_mi,
       true},
      {"mandible_clutch", Step::kCalibrate, "Scan of the clutch", "scan the lower teeth with the clutch on",
       c.files.mandible_clutch, true},
      {"face_mi", Step::kCalibrate, "Face scan in MI", "the second route to T_th needs it", c.files.face_mi,
       false},
      {"face_tp", Step::kCalibrate, "Face scan in TP", "the second route to T_th needs it", c.files.face_tp,
       false},
      {"bow", Step::kCalibrate, "Model of the bow", "name it in [bodies] of case.toml", c.files.bow_model,
       true},
      {"splint", Step::kDesign, "Splint", "build it here, or with 'gnathion run'", splint, true}};
  add_truth(c, wanted);
  return wanted;
}

void read_surfaces(CaseContent& c) {
  const std::vector<Wanted> wanted = wanted_surfaces(c);
  std::vector<std::future<Result<TriangleMesh>>> reading;
  for (const Wanted& w : wanted)
    reading.push_back(std::async(std::launch::async, [path = w.path]() -> Result<TriangleMesh> {
      if (!is_there(path)) return bad_input("", "", "");
      return read_mesh(path);
    }));
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const Wanted& w = wanted[i];
    Result<TriangleMesh> mesh = reading[i].get();
    if (mesh) {
      c.meshes[w.role] = std::make_shared<const TriangleMesh>(std::move(*mesh));
    } else if (is_there(w.path)) {
      c.absences.push_back({w.step, w.shown, w.path.filename().string() + ": " + mesh.error().why, true});
    } else if (const bool named = !w.path.empty() && w.step != Step::kDesign;  // in case.toml
               named || w.required) {
      const std::string file = named ? w.path.filename().string() + " does not exist; " : "";
      c.absences.push_back({w.step, w.shown, file + w.remedy, named});
    }
  }
}

SharedJson read_report(CaseContent& c, const fs::path& path, Step step, const char* what,
                       const char* remedy) {
  if (!is_there(path)) {
    if (*remedy) c.absences.push_back({step, what, remedy, false});
    return nullptr;
  }
  Result<nlohmann::json> j = read_json(path);
  if (j && j->is_object()) return std::make_shared<const nlohmann::json>(std::move(*j));
  c.absences.push_back(
      {step, what, path.filename().string() + (j ? ": not an object" : ": " + j.error().why), true});
  return nullptr;
}

std::optional<MotionFile> read_transform(CaseContent& c, const char* file, const char* remedy) {
  const fs::path path = c.results() / file;
  if (!is_there(path)) {
    if (*remedy) c.absences.push_back({Step::kTransformation, "T_th", remedy, false});
    return std::nullopt;
  }
  if (Result<MotionFile> motion = read_motion(path))
    return std::move(*motion);
  else
    c.absences.push_back({Step::kTransformation, file, motion.error().why, true});
  return std::nullopt;
}

void read_motion_of_jaw(CaseContent& c) {
  const fs::path csv = c.results() / "motion.csv";
  const fs::path mcap = newest_result(c.folder, "motion.mcap", "track", ".mcap");
  if (!is_there(csv)) {
    const char* remedy = is_there(c.files.recording) ? "track the recording: 'gnathion run'"
                                                     : "record a session in Capture first";
    c.absences.push_back({Step::kMotion, "Jaw motion", remedy, false});
  } else if (Result<JawMotion> motion = read_motion_csv(csv)) {
    c.motion = std::move(*motion);
  } else {
    c.absences.push_back({Step::kMotion, "motion.csv", motion.error().why, true});
  }
  if (!is_there(mcap)) return;
  const Result<PoseRecording> poses = read_poses(mcap);
  if (!poses) {
    c.absences.push_back({Step::kMotion, mcap.filename().string(), poses.error().why, true});
    return;
  }
  if (Result<SessionMotion> session = to_session_motion(*poses, mcap.string()))
    c.session = std::make_shared<const SessionMotion>(std::move(*session));
  else
    c.absences.push_back({Step::kMotion, mcap.filename().string(), session.error().why, true});
}

void read_frames(CaseContent& c) {
  if (!is_there(c.results() / "frames.json")) {
    c.absences.push_back({Step::kCalibrate, "Graph of frames", "'gnathion run' registers the scans", false});
    return;
  }
  if (Result<FramesGraph> graph = read_case_frames(c.folder))
    c.frames = std::move(*graph);
  else
    c.absences.push_back({Step::kCalibrate, "Graph of frames", graph.error().why, true});
}

}  // namespace

const char* step_name(Step step) {
  constexpr const char* kNames[] = {"Capture", "Motion", "Calibrate", "Transformation", "Design", "Evaluate"};
  return kNames[static_cast<std::size_t>(step)];
}

SharedMesh CaseContent::mesh(const std::string& role) const {
  const auto at = meshes.find(role);
  return at == meshes.end() ? nullptr : at->second;
}

std::shared_ptr<const CaseContent> load_case(const fs::path& folder) {
  const auto begin = std::chrono::steady_clock::now();
  auto content = std::make_shared<CaseContent>();
  CaseContent& c = *content;
  c.folder = folder;
  std::error_code ec;
  const fs::path whole = fs::weakly_canonical(folder, ec);
  c.title = (ec ? folder : whole).filename().string();
  if (!fs::is_directory(folder, ec)) {
    c.absences.push_back({Step::kCapture, "Case folder", folder.string() + " is not a folder", true});
    return content;
  }
  read_case_file(c);
  read_surfaces(c);
  read_motion_of_jaw(c);
  c.therapeutic = read_transform(c, "T_th.json", "set it below, or find it with 'gnathion run'");
  c.by_camera = read_transform(c, "T_th_camera.json", "");
  c.by_faces = read_transform(c, "T_th_faces.json", "");
  c.chain = read_report(c, newest_result(c.folder, "chain.json", "chain", ".json"), Step::kCalibrate,
                        "Chain of calibration", "'gnathion run' solves it from the scans");
  c.feasibility = read_report(c, c.results() / "feasibility.json", Step::kTransformation, "Feasibility", "");
  c.design =
      read_report(c, c.results() / "design.json", Step::kDesign, "Gates", "a full build measures them");
  c.displacement =
      read_report(c, c.results() / "displacement.json", Step::kTransformation, "Displacement", "");
  read_frames(c);
  if (is_there(folder / "evaluation.toml"))
    c.evaluation = folder / "evaluation.toml";
  else
    c.absences.push_back({Step::kEvaluate, "Scans of the printed splint",
                          "name them in evaluation.toml, or try a virtual print", false});
  const SharedMesh upper = c.mesh("maxilla_mi"), lower = c.mesh("mandible_mi");
  if (upper && lower) {
    if (Result<ArchFrame> arch = find_arch(*upper, *lower))
      c.arch = std::move(*arch);
    else
      c.absences.push_back({Step::kCapture, "Dental arches", arch.error().why, true});
  }
  c.load_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return content;
}

}  // namespace gnathion
