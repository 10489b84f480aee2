#include "pipeline/evaluation_report.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/file.h"
#include "core/time.h"
#include "pipeline/evaluation_document.h"
#include "pipeline/evaluation_pictures.h"
#include "pipeline/html_view.h"
#include "pipeline/version.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

Status keep_picture(const EvaluationFigure& figure, const fs::path& folder) {
  if (!figure.is_map) return write_svg(folder / (figure.file + ".svg"), *figure.drawing, figure.caption);
  GNATHION_TRY(const std::string png, png_bytes(*figure.drawing, 2.0));
  return write_file(folder / (figure.file + ".png"), png);
}

/// All figures of all splints; drawing is most of a report's time.
Result<EvaluationFigures> draw_figures(const EvaluationReport& report, Progress& progress) {
  EvaluationFigures figures;
  figures.overview = overview_figures(report.tables);
  const double range = map_range_mm(report.splints);
  for (std::size_t i = 0; i < report.splints.size(); ++i) {
    progress.update(static_cast<double>(i) / static_cast<double>(report.splints.size()));
    SplintFigures of;
    GNATHION_TRY(of.maps, distance_maps(report.splints[i], range));
    of.histograms = distance_histograms(report.splints[i], range);
    of.profiles = profile_figures(report.splints[i]);
    figures.splints.push_back(std::move(of));
  }
  return figures;
}

Result<std::size_t> keep_pictures(const EvaluationFigures& figures, const fs::path& folder) {
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return fail(ErrorCode::kInternal, "cannot make folder", folder.string(), ec.message());
  std::vector<const EvaluationFigure*> all;
  for (const EvaluationFigure& f : figures.overview) all.push_back(&f);
  for (const SplintFigures& s : figures.splints)
    for (const auto* list : {&s.maps, &s.histograms, &s.profiles})
      for (const EvaluationFigure& f : *list) all.push_back(&f);
  for (const EvaluationFigure* f : all) GNATHION_CHECK_OK(keep_picture(*f, folder));
  return all.size();
}

}  // namespace

Result<ReportSizes> write_evaluation_report(const EvaluationReport& report, const fs::path& folder,
                                            Progress& progress) {
  const Stopwatch watch;
  progress.begin_step("drawing the figures", 0.6);
  GNATHION_TRY(const EvaluationFigures figures, draw_figures(report, progress));
  ReportSizes sizes;
  GNATHION_TRY(sizes.pictures, keep_pictures(figures, folder / "pictures"));

  progress.begin_step("packing the 3D view", 0.25);
  HtmlViewOptions view;
  view.range_mm = map_range_mm(report.splints);
  // Each splint brings three or four scans and a design; together they stay near 4 MB.
  view.triangles =
      std::clamp<std::size_t>(80000 / std::max<std::size_t>(1, report.splints.size()), 4000, 24000);
  const std::string view_html = report.splints.empty() ? "" : html_view(report.splints, view);

  progress.begin_step("setting the report", 0.15);
  const ReportDocument document = evaluation_document(report, figures, view_html);
  const std::string html = html_of(document);
  GNATHION_CHECK_OK(write_file(folder / "report.html", html));
  const PdfInfo info{report.title, fmt::format("gnathion {}", kVersion), report.date_iso};
  const fs::path pdf = folder / "report.pdf";
  GNATHION_CHECK_OK(write_pdf(pdf, pages_of(document, report.title + ". Research use only."), info));
  sizes.html_bytes = html.size();
  std::error_code ec;
  sizes.pdf_bytes = static_cast<std::size_t>(fs::file_size(pdf, ec));
  sizes.seconds = watch.seconds();
  return sizes;
}

namespace {

const char* name_of(SeatRegion region) {
  static const char* const names[] = {"auto", "palate", "crowns", "whole"};
  return names[static_cast<std::size_t>(region)];
}

std::vector<std::pair<std::string, std::string>> parameters_of(const EvaluateJob& job) {
  const EvaluationOptions& o = job.options;
  const StatisticsOptions& s = job.statistics;
  const auto number = [](double v) { return fmt::format("{}", v); };
  std::vector<std::pair<std::string, std::string>> out;
  if (job.rows.empty())
    out = {{"evaluation.seat_region", name_of(o.seat_region)},
           {"evaluation.reach_mm", number(o.reach_mm)},
           {"evaluation.rim_mm", number(o.rim_mm)},
           {"evaluation.steep_deg", number(o.steep_deg)},
           {"evaluation.noise_mm", number(o.noise_mm)},
           {"evaluation.points", std::to_string(o.points)},
           {"evaluation.seed", std::to_string(o.seed)}};
  out.insert(out.end(), {{"statistics.outlier_z", number(s.outlier_z)},
                         {"statistics.length_floor_mm", number(s.length_floor_mm)},
                         {"statistics.angle_floor_deg", number(s.angle_floor_deg)},
                         {"statistics.resamples", std::to_string(s.resamples)},
                         {"statistics.seed", std::to_string(s.seed)}});
  const EvaluationTolerance& t = job.tolerance;
  const std::pair<const char*, const std::optional<double>*> limits[] = {
      {"tolerance.avg_mm", &t.avg_mm},
      {"tolerance.std_mm", &t.std_mm},
      {"tolerance.alpha_deg", &t.alpha_deg},
      {"tolerance.t_mm", &t.t_mm},
      {"tolerance.max_tooth_mm", &t.max_tooth_mm},
      {"tolerance.equivalence_mm", &t.equivalence_mm}};
  for (const auto& [name, value] : limits)
    if (*value) out.emplace_back(name, number(**value));
  return out;
}

/// What a file was given as.
std::string role_of(const std::string& path, const EvaluateJob& job) {
  // Beside the rows only the printed totals are read, also where they were found and not given.
  if (!job.rows.empty()) return path == job.rows ? "rows" : "printed totals";
  if (!job.config.empty() && path == job.config) return "configuration";
  for (const EvaluateSplint& s : job.splints) {
    const std::pair<const char*, const fs::path*> roles[] = {
        {"scan of the splint", &s.scan_splint},
        {"scan of the maxilla", &s.scan_maxilla},
        {"scan of the mandible", &s.scan_mandible},
        {"scan of the splint alone", &s.scan_splint_free},
        {"model of the maxilla", &s.maxilla},
        {"model of the mandible", &s.mandible},
        {"transform", &s.transform}};
    for (const auto& [role, given] : roles)
      if (!given->empty() && path == *given) return "splint " + s.name + ": " + role;
  }
  return "design";
}

}  // namespace

Result<ReportSizes> write_evaluation_report(const EvaluationOutcome& outcome, const fs::path& folder,
                                            const std::string& date_iso, Progress& progress) {
  EvaluationReport r;
  r.splints = outcome.splints;
  r.tables = outcome.tables;
  r.core_tables = outcome.core_tables;
  for (const std::string& v : outcome.violated) r.notes.push_back("beyond tolerance: " + v);
  r.notes.insert(r.notes.end(), outcome.notes.begin(), outcome.notes.end());
  for (const EvaluationInput& i : outcome.inputs)
    r.inputs.push_back({role_of(i.path, outcome.job), i.path, i.sha256});
  r.parameters = parameters_of(outcome.job);
  r.date_iso = date_iso;
  return write_evaluation_report(r, folder, progress);
}

}  // namespace gnathion
