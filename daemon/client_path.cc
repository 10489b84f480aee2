#include "daemon/client_path.h"

#include <fmt/format.h>

#include <algorithm>

namespace gnathion::daemon {

namespace fs = std::filesystem;

ApiResult<fs::path> path_in_case(const CaseRoot& root, const fs::path& case_folder, const std::string& given,
                                 PathUse use) {
  const fs::path path(given);
  const auto outside = [&](const char* why) {
    return refuse(ApiCode::kPermissionDenied,
                  fmt::format("the path '{}' {}: name a file inside the case's folder", given, why));
  };
  if (given.empty()) return refuse(ApiCode::kInvalidArgument, "a path is empty: name a file of the case");
  if (std::any_of(given.begin(), given.end(), [](unsigned char c) { return c < 32 || c == 127; }))
    return refuse(ApiCode::kInvalidArgument, "a path has no control characters: name a file of the case");
  if (path.is_absolute()) return outside("is absolute");
  if (std::find(path.begin(), path.end(), "..") != path.end()) return outside("leads out of the case");
  std::error_code ec;
  fs::path step = case_folder;
  for (const fs::path& part : path) {
    step /= part;
    if (fs::is_symlink(step, ec)) return outside("passes a symbolic link");
  }
  auto resolved = root.resolve((case_folder / path).string(), use);
  if (!resolved) {
    const bool there = fs::exists(case_folder / path, ec);
    return refuse(there || use == PathUse::kNew ? ApiCode::kInvalidArgument : ApiCode::kNotFound,
                  resolved.error().line());
  }
  const auto inside =
      std::mismatch(case_folder.begin(), case_folder.end(), resolved->begin(), resolved->end());
  if (inside.first != case_folder.end()) return outside("leads out of the case");
  return *resolved;
}

bool may_hold_identity(const fs::path& path) {
  const std::string name = path.filename().string();
  return name.empty() || name.front() == '.' || name.find("case.toml") != std::string::npos;
}

}  // namespace gnathion::daemon
