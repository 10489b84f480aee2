#include "daemon/case_listing.h"

#include <sys/stat.h>

#include <algorithm>
#include <map>

#include "pipeline/case_folder.h"

namespace gnathion::daemon {
namespace {

namespace fs = std::filesystem;

std::string role_by_folder(const std::string& path) {
  const std::string top = path.substr(0, path.find('/'));
  if (top == "recordings") return "recording";
  if (top == "results") return "result";
  if (top == "calibrations") return "calibration";
  return {};
}

}  // namespace

CaseListing list_case(const fs::path& folder) {
  const CaseSummary summary = summarize_case(folder, CaseTrust::kConfined);
  CaseListing listing;
  listing.id = summary.id;
  listing.kind = summary.kind;
  listing.problem = summary.problem;
  std::map<std::string, std::string> roles;
  std::error_code ec;
  for (const CaseFileEntry& entry : summary.files)
    roles[fs::relative(entry.path, folder, ec).string()] = entry.role;
  for (auto it = fs::recursive_directory_iterator(folder, ec);
       !ec && it != fs::recursive_directory_iterator(); it.increment(ec)) {
    if (it->path().filename().string().rfind('.', 0) == 0) {
      it.disable_recursion_pending();
      continue;
    }
    struct stat info {};
    if (::lstat(it->path().c_str(), &info) != 0 || !S_ISREG(info.st_mode)) continue;
    const HostTime modified{info.st_mtim.tv_sec * 1'000'000'000 + info.st_mtim.tv_nsec};
    listing.modified = std::max(listing.modified, modified);
    const std::string path = fs::relative(it->path(), folder, ec).string();
    if (path == "case.toml") continue;
    const auto role = roles.find(path);
    listing.files.push_back({path, role != roles.end() ? role->second : role_by_folder(path),
                             static_cast<std::uint64_t>(info.st_size), modified});
  }
  std::sort(listing.files.begin(), listing.files.end(),
            [](const ListedFile& a, const ListedFile& b) { return a.path < b.path; });
  return listing;
}

}  // namespace gnathion::daemon
