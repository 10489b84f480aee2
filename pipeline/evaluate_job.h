// From design folders and scans to an evaluation's folder: what `gnathion evaluate` does.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/progress.h"
#include "core/result.h"
#include "evaluation/evaluation.h"

namespace gnathion {

/// One splint to evaluate: its design's folder and the scans made after printing. Empty paths: not given.
struct EvaluateSplint {
  std::string name;
  std::filesystem::path design;                        ///< folder with design.json and splint.stl
  std::filesystem::path maxilla, mandible, transform;  ///< empty: those that design.json names
  bool mandible_is_in_tp = false;
  std::filesystem::path scan_splint, scan_maxilla, scan_mandible, scan_splint_free;
};

/// Limits that make the command end with exit code 3 when a splint passes them.
struct EvaluationTolerance {
  std::optional<double> avg_mm, std_mm, alpha_deg, t_mm, max_tooth_mm;
  std::optional<double> equivalence_mm;  ///< for the test of equivalence over splints
};

struct EvaluateJob {
  std::vector<EvaluateSplint> splints;
  std::vector<std::filesystem::path> other_designs;  ///< asked when a scan fits its design badly
  EvaluationOptions options;
  StatisticsOptions statistics;
  EvaluationTolerance tolerance;
  std::filesystem::path config;         ///< evaluation.toml, for the record; empty: flags
  std::filesystem::path rows, printed;  ///< statistics only
  bool pictures = true;
};

/// evaluation.toml (docs/evaluation.md). Paths in it are relative to its folder.
Result<EvaluateJob> read_evaluation_file(const std::filesystem::path& toml);

struct EvaluationInput {
  std::string path, sha256;
};

struct EvaluationOutcome {
  std::vector<ProcedureTable> tables;       ///< all measured points
  std::vector<ProcedureTable> core_tables;  ///< without peripheral points; empty for rows
  std::vector<SplintEvaluation> splints;    ///< empty for rows
  std::vector<EvaluationInput> inputs;
  std::vector<std::string> notes;     ///< warnings with the splint's name, and what the rows show
  std::vector<std::string> violated;  ///< tolerances that are not kept: "splint 3: mandibular_sliding t_mm …"
  EvaluateJob job;                    ///< as run
  std::shared_ptr<const nlohmann::json> report;   ///< evaluation.json
  std::shared_ptr<const nlohmann::json> details;  ///< evaluation_details.json
  bool accepted() const { return violated.empty(); }
};

/// Writes evaluation.json and evaluation_details.json into `folder`, which exists. (Pictures and report are
/// drawn from the outcome by their own files.) Errors: kInput for what cannot be evaluated.
Result<EvaluationOutcome> run_evaluation(const EvaluateJob& job, const std::filesystem::path& folder,
                                         Progress& progress);

}  // namespace gnathion
