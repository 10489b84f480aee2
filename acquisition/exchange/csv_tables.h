// Samples as tables: one file a stream, units in the header line.
#pragma once

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "core/sample.h"

namespace gnathion {

/// "plus/Tool" as a file name: "plus.Tool". No two streams have one name, and none leads out of the folder.
std::string file_stem(const std::string& stream);

/// Writes each sample as it comes, of images only times and size. One thread.
class CsvTables {
 public:
  explicit CsvTables(std::filesystem::path folder) : folder_(std::move(folder)) {}
  Status write(const Sample& sample);
  /// A row of "timestamps.csv" in the folder of a camera's images.
  Status write_frame(const FrameSample& frame, const std::string& file);
  /// Closes the tables; their names relative to the folder.
  Result<std::vector<std::string>> finish();

 private:
  Status row(const std::string& file, const std::string& columns, const std::string& text);
  std::filesystem::path folder_;
  std::map<std::string, std::unique_ptr<std::ofstream>> tables_;
  std::optional<HostTime> start_;  ///< of the first sample
};

/// A value as RFC 4180 wants it.
std::string csv_text(const std::string& text);

}  // namespace gnathion
