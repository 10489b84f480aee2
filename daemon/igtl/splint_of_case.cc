#include "daemon/igtl/splint_of_case.h"

#include <filesystem>

#include "core/log.h"
#include "core/mesh_io.h"

namespace gnathion::daemon {

namespace fs = std::filesystem;

std::shared_ptr<const TriangleMesh> newest_splint(const CaseRoot& root, const std::string& case_id) {
  const auto folder = root.case_folder(case_id);
  if (!folder) return nullptr;
  fs::path newest;
  fs::file_time_type newest_time{};
  std::error_code ec;
  for (auto it = fs::recursive_directory_iterator(*folder, ec);
       !ec && it != fs::recursive_directory_iterator(); it.increment(ec)) {
    if (it->path().filename().string().rfind('.', 0) == 0 || it.depth() > 2) it.disable_recursion_pending();
    if (it->path().filename() != "splint.stl" || !it->is_regular_file(ec) || it->is_symlink(ec)) continue;
    const auto time = it->last_write_time(ec);
    if (newest.empty() || time > newest_time) {
      newest = it->path();
      newest_time = time;
    }
  }
  if (newest.empty()) return nullptr;
  auto mesh = read_mesh(newest);
  if (!mesh) {
    log(LogLevel::kWarning, mesh.error().line());
    return nullptr;
  }
  return std::make_shared<const TriangleMesh>(std::move(*mesh));
}

}  // namespace gnathion::daemon
