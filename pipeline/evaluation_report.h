// An evaluation as a report: one HTML file that needs no network, with a 3D view to turn, and the same as
// PDF.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/progress.h"
#include "core/result.h"
#include "evaluation/evaluation.h"
#include "pipeline/evaluate_job.h"

namespace gnathion {

/// A file that went in.
struct ReportInput {
  std::string role, path, sha256;
};

/// All that a report tells. Without `splints` (statistics of published rows) it has tables and charts alone.
struct EvaluationReport {
  std::string title = "Evaluation of occlusal positioning splints";
  std::vector<SplintEvaluation> splints;
  std::vector<ProcedureTable> tables, core_tables;  ///< with and without peripheral points
  std::vector<std::string> notes;
  std::vector<ReportInput> inputs;
  std::vector<std::pair<std::string, std::string>> parameters;  ///< effective, as shown
  std::string date_iso;  ///< "2026-01-31T12:00:00Z"; empty: none is printed
};

struct ReportSizes {
  std::size_t html_bytes = 0, pdf_bytes = 0, pictures = 0;
  double seconds = 0;
};

/// Writes report.html, report.pdf and pictures/ (SVG charts and profiles, PNG distance maps) into `folder`,
/// which exists.
Result<ReportSizes> write_evaluation_report(const EvaluationReport& report,
                                            const std::filesystem::path& folder, Progress& progress);

/// The report of what run_evaluation found, into the same folder.
Result<ReportSizes> write_evaluation_report(const EvaluationOutcome& outcome,
                                            const std::filesystem::path& folder, const std::string& date_iso,
                                            Progress& progress);

}  // namespace gnathion
