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

ApiResult<fs::path> output_in_case(const CaseRoot& root, const fs::path& case_folder,
                                   const std::string& given) {
  const auto known = path_in_case(root, case_folder, given, PathUse::kExisting);
  const bool control =
      std::any_of(given.begin(), given.end(), [](unsigned char c) { return c < 32 || c == 127; });
  if (!known && (control || known.error().code == ApiCode::kPermissionDenied)) return known;
  // As far as there are folders, and the first that is not there, as any new path; the rest is names below
  // it.
  fs::path there, missing;
  std::error_code ec;
  for (const fs::path& part : fs::path(given))
    if (part.empty() || part == ".")
      continue;
    else if (there.empty() || fs::is_directory(case_folder / there, ec))
      there /= part;
    else
      missing /= part;
  if (!missing.empty() && fs::exists(case_folder / there, ec))
    return refuse(ApiCode::kInvalidArgument,
                  fmt::format("'{}' is no folder: choose another", there.string()));
  auto made = path_in_case(root, case_folder, there.empty() ? given : there.string(), PathUse::kNew);
  if (!made || missing.empty()) return made;
  return *made / missing;
}

bool may_hold_identity(const fs::path& path) {
  const std::string name = path.filename().string();
  return name.empty() || name.front() == '.' || name.find("case.toml") != std::string::npos;
}

}  // namespace gnathion::daemon
