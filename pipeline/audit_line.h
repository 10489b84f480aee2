// One line of an audit trail, for audit's own .cc files.
//
//   {"case":"…","details":"…","hash":H,"n":7,"prev":P,"time":"…Z","what":"…","who":"…"}
//
// keys in alphabetical order, no spaces; H is the SHA-256 of the line without "hash", P the H of line n - 1.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include <nlohmann/json_fwd.hpp>

#include "pipeline/audit.h"

namespace gnathion::audit {

/// Escapes make a line up to six times as long as what goes into it.
inline constexpr std::size_t kLongestLine = 64 * 1024;

struct Line {
  std::uint64_t n = 0;
  std::string prev, hash;
  std::string own_hash;    ///< of what stands there
  bool canonical = false;  ///< written as we write
};
std::optional<Line> parse_line(std::string_view text);
std::string hash_of(nlohmann::json line);

std::filesystem::path head_path(const std::filesystem::path& trail);
std::optional<AuditHead> parse_head(const std::string& text);

/// flock() for as long as it lives.
class Lock {
 public:
  Lock(int fd, int how);
  ~Lock();
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;
  bool held() const { return held_; }

 private:
  int fd_;
  bool held_ = false;
};

}  // namespace gnathion::audit
