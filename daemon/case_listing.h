// What a case's folder holds, as clients may know it: without case.toml, where the patient's identity lives.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/time.h"
#include "pipeline/case_path.h"

namespace gnathion::daemon {

struct ListedFile {
  std::string path, role;  ///< inside the case's folder; "scans.maxilla_mi", "recording", "result"
  std::uint64_t bytes = 0;
  HostTime modified;
};

struct CaseListing {
  std::string id, kind, problem;
  std::vector<ListedFile> files;
  HostTime modified;
};

CaseListing list_case(const std::filesystem::path& folder);

}  // namespace gnathion::daemon
