// Recordings for others: tables, image folders, PLUS sequences. docs/exchange.md.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/progress.h"
#include "core/result.h"

namespace gnathion {

struct ExportOptions {
  bool csv = false, images = false;
  std::string plus;         ///< file name within the folder, ".igs.mha" or ".igs.nrrd"; empty: none
  std::string plus_images;  ///< the camera whose images go into the sequence; empty: poses alone
  bool plus_compressed = false;
};

struct ExportSummary {
  std::vector<std::string> files;  ///< written, relative to the folder; image folders once
  std::size_t samples = 0;
};

/// Reads a session's recording, or poses over time (motion.mcap), and writes into the existing folder `out`.
Result<ExportSummary> export_recording(const std::filesystem::path& recording, const ExportOptions& options,
                                       const std::filesystem::path& out, Progress& progress);

}  // namespace gnathion
