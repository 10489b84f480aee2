#include "pipeline/design_job.h"

#include <vector>

#include <tbb/parallel_invoke.h>
#include <tbb/task_group.h>
#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/time.h"
#include "design/tooth_corrections.h"
#include "design/write_3mf.h"
#include "design/write_ply.h"
#include "pipeline/dental_motion.h"
#include "pipeline/label_picture.h"
#include "pipeline/nested_progress.h"
#include "pipeline/pictures.h"
#include "pipeline/profile_pictures.h"
#include "pipeline/provenance.h"
#include "pipeline/undercut_map.h"
#include "pipeline/version.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

Result<InputRecord> record_of(const fs::path& path) {
  GNATHION_TRY(const std::string hash, sha256_of_file(path));
  return InputRecord{path.string(), hash};
}

/// How reports name an input: relative to `folder` where it lies there, what a step of a case made as it is
/// published, others by their name alone: a path tells of the machine and of who works on it.
std::string shown_as(const fs::path& path, const fs::path& folder) {
  if (folder.empty()) return path.string();
  const fs::path inside = path.lexically_relative(folder);
  if (inside.empty() || *inside.begin() == "..") return path.filename().string();
  if (*inside.begin() != ".steps") return inside.string();
  fs::path shown = "results";
  for (auto part = std::next(inside.begin(), 2); part != inside.end(); ++part) shown /= *part;
  return shown.string();
}

/// design.json of a T_th that no splint can realize: what was asked, and why not.
nlohmann::json refusal_json(const DesignJob& job, const DesignInputs& inputs, const Feasibility& feasibility,
                            double total_s) {
  nlohmann::json files = nlohmann::json::array();
  for (const InputRecord& f : inputs.files) files.push_back({{"path", f.path}, {"sha256", f.sha256}});
  return {{"verdict", verdict_name(feasibility.verdict)},
          {"violated", feasibility.violated()},
          {"parameters", parameters_json(job.parameters)},
          {"edits", edits_json(inputs.splint.edits)},
          {"arch", job.arch == Arch::kMaxilla ? "maxilla" : "mandible"},
          {"inputs", files},
          {"version", kVersion},
          {"timing_s", {{"total", total_s}}},
          {"peak_rss_mib", peak_rss_mib()},
          {"gates", nlohmann::json::array()},
          {"apertures", nlohmann::json::array()},
          {"warnings", nlohmann::json::array()}};
}

Status write_splint(const SplintDesign& design, const DesignInputs& inputs, const fs::path& folder) {
  if (design.verdict != "pass") return write_mesh(folder / "splint.rejected.stl", design.splint);
  Status stl, ply, archive;
  tbb::parallel_invoke(
      [&] { stl = write_mesh(folder / "splint.stl", design.splint); },
      [&] {
        ply = write_splint_ply(folder / "splint.ply", {design.splint, design.thickness_mm, design.part});
      },
      [&] {
        archive = write_3mf(folder / "splint.3mf", design.splint,
                            splint_metadata(design, inputs.splint.therapeutic, inputs.files));
      });
  for (const Status& status : {stl, ply, archive}) GNATHION_CHECK_OK(status);
  return {};
}

/// On one thread: there is one drawing context in the process.
Status draw_pictures(const SplintInputs& inputs, const SplintDesign& design,
                     const std::vector<SplintProfile>& profiles, const fs::path& folder) {
  GNATHION_CHECK_OK(draw_design(inputs, design, folder / "pictures"));
  GNATHION_CHECK_OK(draw_profiles(inputs, profiles, folder));
  GNATHION_CHECK_OK(draw_undercut_map(inputs, design, folder));
  return draw_label(design, folder);
}

/// What T_th is checked with, beside the jaws, goes into provenance like any other input.
Status add_knowledge_records(const KnowledgeFiles& known, DesignInputs& in) {
  for (const std::string& path : known.paths()) {
    GNATHION_TRY(const std::string hash, sha256_of(path));
    in.files.push_back({path, hash});
  }
  return {};
}

/// T_th checked with all that is known of the patient.
Result<Feasibility> check_inputs(const DesignJob& job, const DesignInputs& inputs, const NamedJaws& named,
                                 Progress& progress) {
  RealizabilityLimits limits;
  limits.wall_mm = job.parameters.wall_mm;
  limits.aperture_mm = job.parameters.aperture_limit_mm;
  const TriangleMesh &maxilla = inputs.splint.maxilla, &mandible = inputs.splint.mandible_mi;
  RealizabilityChecker checker = RealizabilityChecker::create(maxilla, mandible, named, limits);
  std::vector<std::string> notes = job.known_notes;
  GNATHION_CHECK_OK(add_knowledge(job.known, maxilla, mandible, &checker, &notes, progress));
  Feasibility out = checker.check(inputs.splint.therapeutic, inputs.motion.covariance);
  out.notes.insert(out.notes.end(), notes.begin(), notes.end());
  return out;
}

Status add_excursions(const DesignJob& job, DesignInputs& in) {
  const fs::path calibration = calibration_of(job.motion, job.calibration);
  GNATHION_TRY(const JawMotion motion, read_dental_motion(job.motion, calibration));
  for (const JawMotionRow& row : motion.rows)
    if (row.valid) in.splint.excursions.push_back(row.motion);
  GNATHION_TRY(InputRecord record, record_of(job.motion));
  in.files.push_back(std::move(record));
  if (job.motion.extension() == ".csv") return {};
  GNATHION_TRY(InputRecord chain, record_of(calibration));
  in.files.push_back(std::move(chain));
  return {};
}

}  // namespace

Result<DesignInputs> read_design_inputs(const DesignJob& job) {
  DesignInputs in;
  in.splint.arch = job.arch;
  in.splint.edits = job.edits;
  GNATHION_TRY(in.splint.maxilla, read_jaw(job.maxilla));
  GNATHION_TRY(in.splint.mandible_mi, read_jaw(job.mandible));
  GNATHION_TRY(in.motion, read_motion(job.transform));
  in.splint.therapeutic = in.motion.motion;
  in.splint.therapeutic_covariance = in.motion.covariance;
  for (const fs::path& path : {job.maxilla, job.mandible, job.transform}) {
    GNATHION_TRY(InputRecord record, record_of(path));
    in.files.push_back(std::move(record));
  }
  if (!job.occlusal_surface.empty()) {
    GNATHION_TRY(in.splint.occlusal_surface, read_mesh(job.occlusal_surface));
    GNATHION_TRY(InputRecord record, record_of(job.occlusal_surface));
    in.files.push_back(std::move(record));
  }
  if (!job.motion.empty()) GNATHION_CHECK_OK(add_excursions(job, in));
  GNATHION_CHECK_OK(add_knowledge_records(job.known, in));
  for (InputRecord& file : in.files) file.path = shown_as(file.path, job.shown_folder);
  if (!job.shown_transform.empty()) in.files[2].path = job.shown_transform.string();
  if (job.mandible_is_in_tp) {  // and so is what was marked on it
    const Rigid3 mi_from_tp = in.splint.therapeutic.rigid.inverse();
    in.splint.mandible_mi = transformed(mi_from_tp, in.splint.mandible_mi);
    for (ToothCorrections::Label& label : in.splint.edits.teeth.labels)
      if (label.fdi > 30) label.at_mm = mi_from_tp * label.at_mm;
    if (job.arch == Arch::kMandible)
      for (MarginCurve& margin : in.splint.edits.margins)
        for (Vector3& p : margin.points_mm) p = mi_from_tp * p;
  }
  return in;
}

Result<DesignOutcome> run_design(const DesignJob& job, const fs::path& folder, Progress& progress) {
  const Stopwatch total;
  progress.begin_step("reading the jaws", 0.05);
  GNATHION_TRY(const DesignInputs inputs, read_design_inputs(job));

  progress.begin_step("checking what can be realized", 0.10);
  DesignOutcome outcome;
  GNATHION_TRY(const NamedJaws named,
               name_jaws(inputs.splint.maxilla, inputs.splint.mandible_mi, inputs.splint.edits.teeth));
  GNATHION_CHECK_OK(check_tooth_corrections(inputs.splint, named));
  GNATHION_TRY(outcome.feasibility, check_inputs(job, inputs, named, progress));
  GNATHION_CHECK_OK(write_json(folder / "feasibility.json", feasibility_json(outcome.feasibility)));
  if (outcome.feasibility.verdict == Verdict::kNotRealizable) {
    outcome.report = std::make_shared<json>(refusal_json(job, inputs, outcome.feasibility, total.seconds()));
    GNATHION_CHECK_OK(write_json(folder / "design.json", *outcome.report));
    return outcome;
  }

  NestedProgress building(progress, "building and verifying the splint", 0.70);
  Result<SplintDesign> design = design_splint(inputs.splint, job.parameters, building, &named);
  if (!design && design.error().code == ErrorCode::kGate) {  // no solid came out: a verdict, not an error
    json report = refusal_json(job, inputs, outcome.feasibility, total.seconds());
    report["verdict"] = "fail";
    report["violated"] = {design.error().line()};
    outcome.report = std::make_shared<json>(std::move(report));
    GNATHION_CHECK_OK(write_json(folder / "design.json", *outcome.report));
    return outcome;
  }
  if (!design) return tl::unexpected<Error>(design.error());
  outcome.design = std::move(*design);

  progress.begin_step("writing and drawing", 0.15);
  const SplintDesign& made = *outcome.design;
  const std::vector<SplintProfile> profiles = splint_profiles(inputs.splint, made);
  Status written;
  tbb::task_group writing;
  writing.run([&] { written = write_splint(made, inputs, folder); });
  const Status pictures = job.pictures ? draw_pictures(inputs.splint, made, profiles, folder) : Status();
  writing.wait();
  GNATHION_CHECK_OK(written);
  GNATHION_CHECK_OK(pictures);
  json told = design_json(*outcome.design, inputs.files, kVersion, total.seconds(), peak_rss_mib());
  told["profiles"] = profiles_json(profiles);
  outcome.report = std::make_shared<json>(std::move(told));
  GNATHION_CHECK_OK(write_json(folder / "design.json", *outcome.report));
  return outcome;
}

}  // namespace gnathion
