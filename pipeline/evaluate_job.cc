#include "pipeline/evaluate_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "evaluation/planned_model.h"
#include "pipeline/evaluation_json.h"
#include "pipeline/nested_progress.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

constexpr const char* kWhat = "cannot evaluate";

/// Every file is read once and recorded with its hash.
class Files {
 public:
  Result<SharedMesh> mesh(const fs::path& path, bool jaw) {
    const std::string key = fs::weakly_canonical(path).string();
    const auto known = meshes_.find(key);
    if (known != meshes_.end()) return known->second;
    GNATHION_CHECK_OK(record(path));
    GNATHION_TRY(TriangleMesh mesh, jaw ? read_jaw(path) : read_mesh(path));
    return meshes_[key] = std::make_shared<const TriangleMesh>(std::move(mesh));
  }
  Result<SharedMesh> mesh_or_none(const fs::path& path) {
    if (path.empty()) return SharedMesh();
    return mesh(path, true);
  }
  Status record(const fs::path& path) {
    const std::string key = fs::weakly_canonical(path).string();
    if (hashes_.count(key)) return {};
    GNATHION_TRY(const std::string hash, sha256_of_file(path));
    hashes_[key] = hash;
    inputs_.push_back({path.string(), hash});
    return {};
  }
  std::string hash(const fs::path& path) const {
    const auto found = hashes_.find(fs::weakly_canonical(path).string());
    return found == hashes_.end() ? std::string() : found->second;
  }
  std::vector<EvaluationInput> inputs() const { return inputs_; }

 private:
  std::map<std::string, SharedMesh> meshes_;
  std::map<std::string, std::string> hashes_;
  std::vector<EvaluationInput> inputs_;
};

/// A file that design.json names: as it is named, or beside the design's folder or its parents; the one whose
/// contents are those that the splint was designed on.
Result<fs::path> designed_on(const fs::path& design, const json& inputs, std::size_t index,
                             const char* option) {
  const std::string where = (design / "design.json").string();
  if (!inputs.is_array() || inputs.size() <= index || !inputs[index].contains("path"))
    return bad_input(kWhat, where, fmt::format("names no input {}; give --{}", index + 1, option));
  const fs::path named = inputs[index].value("path", "");
  const std::string hash = inputs[index].value("sha256", "");
  const fs::path folder = fs::weakly_canonical(design);
  bool changed = false;
  for (const fs::path& candidate : {named, folder / named, folder.parent_path() / named,
                                    folder.parent_path().parent_path() / named, folder / named.filename()}) {
    std::error_code ec;
    if (!fs::is_regular_file(candidate, ec)) continue;
    const Result<std::string> found = sha256_of_file(candidate);
    if (found && (hash.empty() || *found == hash)) return candidate;
    changed = true;
  }
  return bad_input(
      kWhat, where,
      fmt::format("{} {}; give --{} to use another", named.string(),
                  changed ? "has changed since the splint was designed on it" : "is not there", option));
}

/// What is on the disk about one design; empty paths of `s` are taken from design.json.
Result<PlannedSplint> read_design(const EvaluateSplint& s, Files& files) {
  GNATHION_TRY(const json design, read_json(s.design / "design.json"));
  GNATHION_CHECK_OK(files.record(s.design / "design.json"));
  if (!design.is_object()) return bad_input(kWhat, (s.design / "design.json").string(), "not a design");
  const json inputs = design.value("inputs", json::array());
  fs::path maxilla = s.maxilla, mandible = s.mandible, transform = s.transform;
  if (maxilla.empty()) {
    GNATHION_TRY(maxilla, designed_on(s.design, inputs, 0, "maxilla"));
  }
  if (mandible.empty()) {
    GNATHION_TRY(mandible, designed_on(s.design, inputs, 1, "mandible"));
  }
  if (transform.empty()) {
    GNATHION_TRY(transform, designed_on(s.design, inputs, 2, "transform"));
  }
  std::error_code ec;
  const fs::path splint = s.design / "splint.stl";
  if (!fs::exists(splint, ec))
    return bad_input(kWhat, s.design.string(),
                     fs::exists(s.design / "splint.rejected.stl", ec)
                         ? "its splint was rejected; there is no splint.stl"
                         : "there is no splint.stl");
  PlannedSplint planned;
  planned.name = fs::weakly_canonical(s.design).filename().string();
  GNATHION_TRY(planned.splint, files.mesh(splint, true));
  GNATHION_TRY(planned.maxilla, files.mesh(maxilla, true));
  GNATHION_TRY(planned.mandible_mi, files.mesh(mandible, true));
  GNATHION_TRY(const MotionFile motion, read_motion(transform));
  GNATHION_CHECK_OK(files.record(transform));
  planned.therapeutic = motion.motion;
  if (s.mandible_is_in_tp)
    planned.mandible_mi = std::make_shared<const TriangleMesh>(
        transformed(planned.therapeutic.rigid.inverse(), *planned.mandible_mi));
  return planned;
}

Result<SplintScans> read_scans(const EvaluateSplint& s, Files& files) {
  if (s.scan_splint.empty()) return fail(ErrorCode::kUsage, kWhat, s.name, "no scan of the splint");
  SplintScans scans;
  GNATHION_TRY(scans.splint, files.mesh(s.scan_splint, true));
  GNATHION_TRY(scans.maxilla, files.mesh_or_none(s.scan_maxilla));
  GNATHION_TRY(scans.mandible, files.mesh_or_none(s.scan_mandible));
  GNATHION_TRY(scans.splint_free, files.mesh_or_none(s.scan_splint_free));
  return scans;
}

Status check_names(const std::vector<EvaluateSplint>& splints) {
  std::set<std::string> names;
  for (const EvaluateSplint& s : splints)
    if (!names.insert(s.name).second)
      return bad_input(kWhat, s.name, "two splints have this name; give each its own");
  return {};
}

/// One scan given for two splints is one measurement, not two.
void note_shared_scans(const std::vector<EvaluateSplint>& splints, const Files& files,
                       std::vector<std::string>* notes) {
  struct Role {
    fs::path EvaluateSplint::*path;
    const char* name;
  };
  for (const Role& role :
       {Role{&EvaluateSplint::scan_splint, "splint"}, Role{&EvaluateSplint::scan_maxilla, "maxilla"},
        Role{&EvaluateSplint::scan_mandible, "mandible"}}) {
    std::map<std::string, std::vector<std::string>> of_hash;
    for (const EvaluateSplint& s : splints)
      if (!(s.*role.path).empty()) of_hash[files.hash(s.*role.path)].push_back(s.name);
    for (const auto& [hash, names] : of_hash) {
      if (names.size() < 2) continue;
      std::string list;
      for (const std::string& n : names) list += (list.empty() ? "" : ", ") + n;
      notes->push_back(fmt::format("the scans of the {} of splints {} are one scan", role.name, list));
    }
  }
}

std::vector<std::string> violations(const std::vector<ProcedureTable>& tables, const EvaluationTolerance& t) {
  std::vector<std::string> out;
  for (const ProcedureTable& table : tables) {
    for (const SplintRow& r : table.splints) {
      const auto check = [&](const char* name, std::optional<double> value, std::optional<double> limit) {
        if (value && limit && std::abs(*value) > *limit)
          out.push_back(fmt::format("splint {}: {} {} {:.4f} exceeds {:g}", r.splint, table.procedure, name,
                                    *value, *limit));
      };
      check("avg_mm", r.avg_mm, t.avg_mm);
      check("std_mm", r.std_mm, t.std_mm);
      check("alpha_deg", r.alpha_deg, t.alpha_deg);
      check("t_mm", r.t_mm, t.t_mm);
      check("max_tooth_mm", r.max_tooth_mm, t.max_tooth_mm);
    }
    if (!t.equivalence_mm) continue;
    if (!table.equivalence)
      out.push_back(fmt::format("{}: equivalence cannot be tested with {} splint", table.procedure,
                                table.splints.size()));
    else if (!table.equivalence->equivalent())
      out.push_back(fmt::format("{}: not shown to be within {:g} mm (p {:.3f})", table.procedure,
                                *t.equivalence_mm,
                                std::max(table.equivalence->p_lower, table.equivalence->p_upper)));
  }
  return out;
}

Status evaluate_rows(EvaluationOutcome& out, Files& files, Progress& progress) {
  progress.begin_step("statistics", 1.0);
  GNATHION_TRY(const std::string text, read_file(out.job.rows));
  GNATHION_CHECK_OK(files.record(out.job.rows));
  GNATHION_TRY(out.tables, parse_rows(text, out.job.rows.string(), out.job.statistics));
  // What was printed under the rows: as given, or beside them by its usual name.
  fs::path printed = out.job.printed;
  std::error_code ec;
  if (printed.empty() && fs::is_regular_file(out.job.rows.parent_path() / "printed_totals.csv", ec))
    printed = out.job.rows.parent_path() / "printed_totals.csv";
  std::vector<PrintedTotals> totals;
  if (!printed.empty()) {
    GNATHION_TRY(const std::string printed_text, read_file(printed));
    GNATHION_CHECK_OK(files.record(printed));
    GNATHION_TRY(totals, parse_printed(printed_text, printed.string()));
  }
  out.notes = notes_on(out.tables, totals);
  return {};
}

Status evaluate_scans(EvaluationOutcome& out, Files& files, Progress& progress) {
  GNATHION_CHECK_OK(check_names(out.job.splints));
  progress.begin_step("reading the designs", 0.15);
  std::vector<PlannedSplint> designs, others;
  for (const EvaluateSplint& s : out.job.splints) {
    GNATHION_TRY(PlannedSplint planned, read_design(s, files));
    designs.push_back(std::move(planned));
  }
  others = designs;
  for (const fs::path& folder : out.job.other_designs) {
    EvaluateSplint s = out.job.splints.front();  // the same patient's jaws, where its design.json has none
    s.design = folder;
    GNATHION_TRY(PlannedSplint planned, read_design(s, files));
    others.push_back(std::move(planned));
  }

  const double share = 0.8 / static_cast<double>(designs.size());
  std::shared_ptr<const PlannedModel> model;
  for (std::size_t i = 0; i < designs.size(); ++i) {
    const EvaluateSplint& s = out.job.splints[i];
    NestedProgress step(progress, "splint " + s.name, share);
    EvaluationCase input{s.name, designs[i], {}};
    GNATHION_TRY(input.scans, read_scans(s, files));
    const bool same = model && model->planned().splint == designs[i].splint &&
                      model->planned().mandible_mi == designs[i].mandible_mi;
    if (!same) {
      model.reset();
      GNATHION_TRY(model, PlannedModel::make(designs[i], out.job.options));
    }
    GNATHION_TRY(SplintEvaluation evaluated, evaluate_splint(*model, input, others, out.job.options, step));
    for (const std::string& w : evaluated.warnings)
      out.notes.push_back(fmt::format("splint {}: {}", s.name, w));
    out.splints.push_back(std::move(evaluated));
  }
  progress.begin_step("statistics", 0.05);
  out.tables = tables_of(out.splints, out.job.statistics);
  out.core_tables = core_tables_of(out.splints, out.job.statistics);
  note_shared_scans(out.job.splints, files, &out.notes);
  for (std::string& note : notes_on(out.tables, {})) out.notes.push_back(std::move(note));
  return {};
}

}  // namespace

Result<EvaluationOutcome> run_evaluation(const EvaluateJob& job, const fs::path& folder, Progress& progress) {
  EvaluationOutcome out;
  out.job = job;
  out.job.statistics.equivalence_mm = job.tolerance.equivalence_mm;
  Files files;
  if (!job.config.empty()) GNATHION_CHECK_OK(files.record(job.config));
  if (!job.rows.empty()) {
    GNATHION_CHECK_OK(evaluate_rows(out, files, progress));
  } else {
    if (job.splints.empty()) return fail(ErrorCode::kUsage, kWhat, "splints", "none given");
    GNATHION_CHECK_OK(evaluate_scans(out, files, progress));
  }
  out.inputs = files.inputs();
  out.violated = violations(out.tables, job.tolerance);
  out.report = std::make_shared<const json>(evaluation_json(out.tables, out.notes));
  out.details = std::make_shared<const json>(evaluation_details_json(out));
  GNATHION_CHECK_OK(write_json(folder / "evaluation.json", *out.report));
  GNATHION_CHECK_OK(write_json(folder / "evaluation_details.json", *out.details));
  return out;
}

}  // namespace gnathion
