// Virtual print of one design or several side by side: what `gnathion evaluate virtual-print` does.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/progress.h"
#include "core/result.h"
#include "evaluation/virtual_print.h"

namespace gnathion {

struct VirtualPrintJob {
  std::vector<std::filesystem::path> designs;  ///< folders with design.json and splint.stl
  /// For one design whose files have moved since; empty: those that design.json names.
  std::filesystem::path maxilla, mandible, transform;
  bool mandible_is_in_tp = false;
  VirtualPrintOptions options;
  std::string date_iso;  ///< printed in the report; empty: none
};

struct VirtualPrintOutcome {
  std::vector<VirtualPrint> prints;              ///< in the job's order
  std::shared_ptr<const nlohmann::json> report;  ///< virtual_print.json
};

/// Writes virtual_print.json, rows_DESIGN.csv (as `evaluate --rows` reads them), report.html, report.pdf and
/// pictures/ into `folder`, which exists. Errors: kInput for designs that cannot be read, whose splint was
/// rejected or whose scans are no longer what design.json says.
Result<VirtualPrintOutcome> run_virtual_print(const VirtualPrintJob& job, const std::filesystem::path& folder,
                                              Progress& progress);

/// The predicted table for people.
std::string virtual_print_text(const VirtualPrintOutcome& outcome);

}  // namespace gnathion
