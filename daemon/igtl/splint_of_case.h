// The splint that goes out by OpenIGTLink.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "core/mesh.h"
#include "core/time.h"
#include "pipeline/case_path.h"

namespace gnathion::daemon {

/// Read once as long as its file stays the same, and looked for at most once a second, however many clients
/// come. One thread.
class SplintOfCase {
 public:
  /// A larger file goes to no client: reading it would keep the poses waiting.
  static constexpr std::uintmax_t kMostBytes = std::uintmax_t{32} << 20;
  SplintOfCase(const CaseRoot& root, Clock& clock) : root_(root), clock_(clock) {}
  /// results/splint.stl of the case, or the newest */splint.stl of its designs; null when there is none.
  std::shared_ptr<const TriangleMesh> newest(const std::string& case_id);

 private:
  struct Found {
    std::filesystem::path file;
    std::filesystem::file_time_type time{};
    std::uintmax_t bytes = 0;
    bool operator==(const Found&) const = default;
  };
  static Found find(const std::filesystem::path& folder);
  const CaseRoot& root_;
  Clock& clock_;
  std::string case_id_;
  HostTime looked_;
  Found found_;
  std::shared_ptr<const TriangleMesh> mesh_;
};

}  // namespace gnathion::daemon
