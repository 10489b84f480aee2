// From designs to a printer's plates: build direction, layout, compensation. What `gnathion print prepare`
// does.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/progress.h"
#include "core/result.h"

namespace gnathion {

struct PrintJob {
  std::vector<std::filesystem::path> designs;  ///< folders that `gnathion design` wrote; one may come twice
  std::filesystem::path profile;               ///< docs/printing.md
  std::string material;                        ///< of the profile; empty: none, its gap is not compared
};

struct PrintOutcome {
  std::shared_ptr<const nlohmann::json> report;  ///< print.json
  std::size_t parts = 0, plates = 0;
  std::vector<std::string> warnings;
  bool passed = false;  ///< no blocking gate failed
};

/// Writes into `folder` (which exists) print.json and, for each plate, plate_N.3mf (the splints turned and
/// compensated, each with its place as transform) and plate_N.stl (the same, transformed); nothing but
/// print.json when a gate that blocks fails. Refused: a design that was rejected (kGate), a part that no
/// plate holds (kGate), files that are missing or not the design's (kInput).
Result<PrintOutcome> prepare_print(const PrintJob& job, const std::filesystem::path& folder,
                                   Progress& progress);

}  // namespace gnathion
