#include "pipeline/case_lock.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <string>

namespace gnathion {
namespace {

std::string holder_of(int fd) {
  std::array<char, 32> text{};
  const ssize_t n = ::pread(fd, text.data(), text.size() - 1, 0);
  std::string digits;
  for (ssize_t i = 0;
       i < n && text[static_cast<std::size_t>(i)] >= '0' && text[static_cast<std::size_t>(i)] <= '9'; ++i)
    digits += text[static_cast<std::size_t>(i)];
  return digits.empty() ? "" : " (process " + digits + ")";
}

}  // namespace

Result<CaseLock> CaseLock::take(const std::filesystem::path& folder, const char* what) {
  const std::filesystem::path path = folder / ".lock";
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0600);
  if (fd < 0) {
    const int why = errno;
    const bool folder_missing = why == ENOENT || why == ENOTDIR;
    return fail(folder_missing ? ErrorCode::kInput : ErrorCode::kInternal, what, folder.string(),
                why == EACCES || why == EROFS
                    ? "the folder cannot be written to; make it writable or copy the case"
                : folder_missing ? "is no folder"
                                 : std::strerror(why));
  }
  CaseLock lock(fd);
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK) return fail(ErrorCode::kInternal, what, folder.string(), std::strerror(errno));
    return fail(ErrorCode::kUsage, what, folder.string(),
                fmt::format("another run{} works in it; wait for its end", holder_of(fd)));
  }
  const std::string pid = fmt::format("{}\n", ::getpid());
  if (::ftruncate(fd, 0) != 0 || ::pwrite(fd, pid.data(), pid.size(), 0) < 0) {
    // Only the message of who comes second is poorer.
  }
  return lock;
}

CaseLock::~CaseLock() {
  if (fd_ >= 0) ::close(fd_);
}

}  // namespace gnathion
