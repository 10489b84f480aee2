#include "daemon/igtl/splint_of_case.h"

#include <fmt/format.h>

#include "core/log.h"
#include "core/mesh_io.h"

namespace gnathion::daemon {

namespace fs = std::filesystem;
namespace {

constexpr int kMostEntries = 5000;  // of a case's folder that are looked at
constexpr double kLook_s = 1;

}  // namespace

SplintOfCase::Found SplintOfCase::find(const fs::path& folder) {
  Found newest;
  std::error_code ec;
  int looked_at = 0;
  for (auto it = fs::recursive_directory_iterator(folder, ec);
       !ec && it != fs::recursive_directory_iterator() && ++looked_at < kMostEntries; it.increment(ec)) {
    if (it->path().filename().string().rfind('.', 0) == 0 || it.depth() > 2) it.disable_recursion_pending();
    std::error_code one;
    if (it->path().filename() != "splint.stl" || !fs::is_regular_file(it->symlink_status(one))) continue;
    const Found here{it->path(), it->last_write_time(one), it->file_size(one)};
    if (!one && (newest.file.empty() || here.time > newest.time)) newest = here;
  }
  return newest;
}

std::shared_ptr<const TriangleMesh> SplintOfCase::newest(const std::string& case_id) {
  const HostTime now = clock_.now();
  if (case_id == case_id_ && now.seconds_since(looked_) < kLook_s) return mesh_;
  case_id_ = case_id;
  looked_ = now;
  const auto folder = root_.case_folder(case_id);
  const Found found = folder ? find(*folder) : Found{};
  if (found == found_) return mesh_;
  found_ = found;
  mesh_ = nullptr;
  if (found.file.empty()) return mesh_;
  if (found.bytes > kMostBytes) {
    log(LogLevel::kWarning,
        fmt::format("OpenIGTLink: the splint of case {} has {} MiB, more than the {} that are sent", case_id,
                    found.bytes >> 20, kMostBytes >> 20));
    return mesh_;
  }
  auto mesh = read_mesh(found.file);
  if (mesh)
    mesh_ = std::make_shared<const TriangleMesh>(std::move(*mesh));
  else
    log(LogLevel::kWarning, mesh.error().line());
  return mesh_;
}

}  // namespace gnathion::daemon
