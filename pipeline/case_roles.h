// What a file can be in a case: its key in case.toml, and its place in a folder that gnathion fills.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "pipeline/case_file.h"

namespace gnathion {

enum class CaseFileKind { kMesh, kToml, kRecording, kJson, kMotion, kTransform, kVolume };

struct CaseRole {
  const char* section;
  const char* key;
  std::filesystem::path CaseFile::*member;
  const char* folder;  ///< of the case, where copies go
  CaseFileKind kind;

  std::string name() const { return std::string(section) + "." + key; }
};

/// In the order of case.toml.
const std::vector<CaseRole>& case_roles();
/// By "scans.maxilla_mi", or by the key alone where one role has it; null: there is none.
const CaseRole* find_case_role(std::string_view name);

}  // namespace gnathion
