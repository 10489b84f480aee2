// case.toml: what a case folder holds, by role. Paths are relative to the folder.
#pragma once

#include <filesystem>
#include <string>

#include "core/result.h"
#include "design/edits.h"
#include "design/parameters.h"

namespace gnathion {

/// Paths are absolute once read; absent entries are empty.
struct CaseFile {
  std::filesystem::path folder;
  std::string kind;  ///< "phantom" or "patient"
  std::filesystem::path maxilla_mi, mandible_mi, maxilla_tp, mandible_tp, mandible_clutch, face_mi, face_tp;
  std::filesystem::path bow_model, head_frame_model;
  std::filesystem::path rig, recording;
  std::filesystem::path truth;  ///< phantoms only
  SplintParameters parameters;  ///< [design], over the defaults
  SplintEdits edits;            ///< [[design.stroke]] and the like

  std::filesystem::path toml() const { return folder / "case.toml"; }
};

/// Reads FOLDER/case.toml. Refused with kInput: what is not TOML, an unknown key, a file that is named but
/// does not exist, a case without both jaws in MI.
Result<CaseFile> read_case(const std::filesystem::path& folder);

}  // namespace gnathion
