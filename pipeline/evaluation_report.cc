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

}  // namespace gnathion
