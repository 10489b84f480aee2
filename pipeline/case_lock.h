// One writer at a time in a case folder.
#pragma once

#include <filesystem>

#include "core/result.h"

namespace gnathion {

/// Held until it goes; a process that dies lets go of it. Released and taken by flock() on FOLDER/.lock.
class CaseLock {
 public:
  /// Refused (kUsage) while another process, or this one, holds it: the message names the holder. `what` is
  /// what the error says could not be done. A folder that cannot be written is told as that.
  static Result<CaseLock> take(const std::filesystem::path& folder, const char* what);
  ~CaseLock();
  CaseLock(CaseLock&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  CaseLock& operator=(CaseLock&&) = delete;

 private:
  explicit CaseLock(int fd) : fd_(fd) {}
  int fd_;
};

}  // namespace gnathion
