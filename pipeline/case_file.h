// case.toml: what a case folder holds, by role. Paths are relative to the folder.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "core/result.h"

namespace gnathion {

/// Absent entries are empty paths. docs/formats.md has a commented example.
struct CaseFile {
  std::filesystem::path folder;
  std::string id;  ///< stands in logs, pictures and reports; never a patient's name
  std::optional<std::uint64_t> phantom_seed;  ///< the case is a virtual patient
  // [scans]
  std::filesystem::path maxilla_mi, mandible_mi, maxilla_tp, mandible_tp, mandible_clutch, face_mi, face_tp;
  // [bodies]
  std::filesystem::path bow_model, head_frame_model, rig;
  // [recordings]
  std::filesystem::path session;
  // [truth]
  std::filesystem::path truth;
};

/// Reads FOLDER/case.toml; every file it names must exist. Unknown keys are refused by name.
Result<CaseFile> read_case(const std::filesystem::path& folder);

}  // namespace gnathion
