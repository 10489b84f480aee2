// A retention ladder: one splint for each engagement and gap, to find what fits with a printer and material.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "pipeline/design_job.h"

namespace gnathion {

struct Ladder {
  std::vector<double> engagement_mm = {0.0, 0.025, 0.05};  ///< r
  std::vector<double> gap_mm = {0.05, 0.08, 0.1, 0.12};    ///< g (PMID 31053289: 0.05 to 0.12)
};

struct LadderOutcome {
  std::shared_ptr<const nlohmann::json> report;  ///< ladder.json
  std::size_t rungs = 0, accepted = 0;
  std::string table;  ///< for people: a line for each rung
};

/// Designs every pair of the ladder (over the job's parameters) into folder/r0.050_g0.100 and so on, each a
/// design's folder, and writes ladder.json. Values are rounded to 0.001 mm; equal ones count once. Refused
/// (kUsage): an empty ladder, one of more than 64 rungs, values out of range.
Result<LadderOutcome> run_ladder(const DesignJob& job, const Ladder& ladder,
                                 const std::filesystem::path& folder, Progress& progress);

}  // namespace gnathion
