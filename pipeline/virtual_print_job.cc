#include "pipeline/virtual_print_job.h"

#include <fmt/format.h>

#include <set>

#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/transform_io.h"
#include "pipeline/nested_progress.h"
#include "pipeline/planned_splint.h"
#include "pipeline/version.h"
#include "pipeline/virtual_print_document.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

json figure_json(const PredictedFigure& f) {
  return {{"mean", f.mean}, {"p05", f.low}, {"p95", f.high}};
}
json figure_json(const std::optional<PredictedFigure>& f) {
  return f ? figure_json(*f) : json();
}
template <class T>
json or_null(const std::optional<T>& value) {
  return value ? json(*value) : json();
}

json procedure_json(const PredictedProcedure& p) {
  json rows = json::array();
  for (const SplintRow& r : p.table.splints)
    rows.push_back({{"splint", r.splint},
                    {"n", r.n},
                    {"avg_mm", r.avg_mm},
                    {"std_mm", r.std_mm},
                    {"alpha_deg", or_null(r.alpha_deg)},
                    {"t_mm", or_null(r.t_mm)},
                    {"max_tooth_mm", or_null(r.max_tooth_mm)},
                    {"outlier", r.outlier}});
  return {{"procedure", p.table.procedure},
          {"splints", rows},
          {"n_total", p.table.totals.n_total},
          {"weighted_mean_mm", p.table.totals.weighted_mean_mm},
          {"total_std_mm", p.table.totals.total_std_mm},
          {"within_std_mm", p.table.totals.within_std_mm},
          {"predicted",
           {{"avg_mm", figure_json(p.avg_mm)},
            {"std_mm", figure_json(p.std_mm)},
            {"alpha_deg", figure_json(p.alpha_deg)},
            {"t_mm", figure_json(p.t_mm)},
            {"max_tooth_mm", figure_json(p.max_tooth_mm)}}}};
}

json print_json(const VirtualPrint& print) {
  json procedures = json::array(), core = json::array();
  for (const PredictedProcedure& p : print.procedures) procedures.push_back(procedure_json(p));
  for (const PredictedProcedure& p : print.core) core.push_back(procedure_json(p));
  return {{"design", print.design},
          {"procedures", procedures},
          {"without_peripheral_points", core},
          {"refused", print.refused},
          {"warnings", print.warnings}};
}

json report_json(const VirtualPrintJob& job, const std::vector<VirtualPrint>& prints,
                 const std::vector<ReportInput>& inputs) {
  json designs = json::array(), values = json::object(), files = json::array();
  for (const VirtualPrint& p : prints) designs.push_back(print_json(p));
  VirtualPrintOptions copy = job.options;
  for (const auto& [name, value] : magnitudes(copy)) values[name] = *value;
  for (const ReportInput& i : inputs)
    files.push_back({{"role", i.role}, {"path", i.path}, {"sha256", i.sha256}});
  return {{"designs", designs},
          {"trials", job.options.trials},
          {"seed", job.options.seed},
          {"magnitudes", values},
          {"inputs", files},
          {"version", kVersion},
          {"predicted_not_measured", true}};
}

/// The trials as the published rows are told.
std::string rows_csv(const VirtualPrint& print) {
  std::string csv = "procedure,splint,n,avg_mm,std_mm,alpha_deg,t_mm,max_tooth_mm\n";
  const auto cell = [](const std::optional<double>& v) {
    return v ? fmt::format("{:.4f}", *v) : std::string();
  };
  for (const PredictedProcedure& p : print.procedures)
    for (const SplintRow& r : p.table.splints)
      csv += fmt::format("{},{},{},{:.4f},{:.4f},{},{},{}\n", p.table.procedure, r.splint, r.n, r.avg_mm,
                         r.std_mm, cell(r.alpha_deg), cell(r.t_mm), cell(r.max_tooth_mm));
  return csv;
}

/// Designs with names of their own: two folders called "results" become "results" and "results 2".
void name_apart(std::vector<PlannedFiles>& designs) {
  std::set<std::string> taken;
  for (PlannedFiles& d : designs) {
    const std::string name = d.planned.name;
    for (int n = 2; !taken.insert(d.planned.name).second; ++n) d.planned.name = fmt::format("{} {}", name, n);
  }
}

Result<std::vector<PlannedFiles>> read_designs(const VirtualPrintJob& job) {
  std::vector<PlannedFiles> designs;
  for (const fs::path& folder : job.designs) {
    EvaluateSplint files;
    files.design = folder;
    files.maxilla = job.maxilla;
    files.mandible = job.mandible;
    files.transform = job.transform;
    files.mandible_is_in_tp = job.mandible_is_in_tp;
    GNATHION_TRY(PlannedFiles read, read_planned_splint(files));
    designs.push_back(std::move(read));
  }
  name_apart(designs);
  return designs;
}

std::vector<ReportInput> inputs_of(const std::vector<PlannedFiles>& designs) {
  static const char* const roles[] = {"splint", "maxilla", "mandible", "transform"};
  std::vector<ReportInput> inputs;
  for (const PlannedFiles& d : designs)
    for (std::size_t i = 0; i < d.inputs.size(); ++i)
      inputs.push_back({d.planned.name + ": " + roles[i], d.inputs[i].path, d.inputs[i].sha256});
  return inputs;
}

Status write_documents(const VirtualPrintJob& job, const std::vector<VirtualPrint>& prints,
                       const std::vector<ReportInput>& inputs, const fs::path& folder) {
  const std::vector<EvaluationFigure> figures = virtual_print_figures(prints, job.options);
  std::error_code ec;
  fs::create_directories(folder / "pictures", ec);
  for (const EvaluationFigure& f : figures)
    GNATHION_CHECK_OK(write_svg(folder / "pictures" / (f.file + ".svg"), *f.drawing, f.caption));
  const ReportDocument d = virtual_print_document(prints, job.options, inputs, figures, job.date_iso);
  GNATHION_CHECK_OK(write_file(folder / "report.html", html_of(d)));
  return write_pdf(folder / "report.pdf", pages_of(d, d.title + ". A prediction. Research use only."),
                   {d.title, fmt::format("gnathion {}", kVersion), job.date_iso});
}

}  // namespace

Result<VirtualPrintOutcome> run_virtual_print(const VirtualPrintJob& job, const fs::path& folder,
                                              Progress& progress) {
  if (job.designs.empty())
    return fail(ErrorCode::kUsage, "cannot print virtually", "--design", "no design is given");
  GNATHION_CHECK_OK(check_options(job.options));
  progress.begin_step("reading the designs", 0.05);
  GNATHION_TRY(const std::vector<PlannedFiles> designs, read_designs(job));
  const std::vector<ReportInput> inputs = inputs_of(designs);

  VirtualPrintOutcome out;
  for (const PlannedFiles& d : designs) {
    progress.begin_step("printing " + d.planned.name + " virtually",
                        0.9 / static_cast<double>(designs.size()));
    GNATHION_TRY(VirtualPrint print, virtual_print(d.planned, job.options, progress));
    print.warnings.insert(print.warnings.begin(), d.warnings.begin(), d.warnings.end());
    out.prints.push_back(std::move(print));
  }

  progress.begin_step("writing the report", 0.05);
  out.report = std::make_shared<json>(report_json(job, out.prints, inputs));
  GNATHION_CHECK_OK(write_json(folder / "virtual_print.json", *out.report));
  for (const VirtualPrint& p : out.prints)
    GNATHION_CHECK_OK(write_file(folder / ("rows_" + file_part(p.design) + ".csv"), rows_csv(p)));
  GNATHION_CHECK_OK(write_documents(job, out.prints, inputs, folder));
  return out;
}

std::string virtual_print_text(const VirtualPrintOutcome& outcome) {
  std::string text = "predicted, not measured\n";
  for (const VirtualPrint& print : outcome.prints) {
    text += fmt::format("{}\n  {:<26}{:>10}{:>10}{:>10}{:>10}\n", print.design, "", "AVG mm", "STD mm",
                        "alpha deg", "t mm");
    for (const PredictedProcedure& p : print.procedures)
      text += fmt::format("  {:<26}{:>10.3f}{:>10.3f}{:>10}{:>10}\n", p.table.procedure, p.avg_mm.mean,
                          p.std_mm.mean, p.alpha_deg ? fmt::format("{:.3f}", p.alpha_deg->mean) : "",
                          p.t_mm ? fmt::format("{:.3f}", p.t_mm->mean) : "");
    for (const std::string& r : print.refused) text += "  refused: " + r + "\n";
  }
  return text;
}

}  // namespace gnathion
