#include "acquisition/disk_reserve.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <string>

#include "core/random.h"

namespace gnathion {
namespace {

/// Bytes that a compressing file system cannot make smaller.
const std::string& ballast() {
  static const std::string block = [] {
    std::string made(std::size_t{1} << 16, '\0');
    Random random(0xBA11A57);
    for (char& c : made) c = static_cast<char>(random.next_u32());
    return made;
  }();
  return block;
}

int open_without_name(const std::filesystem::path& path) {
  const std::filesystem::path folder = path.has_parent_path() ? path.parent_path() : ".";
  const int fd = ::open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0600);
  if (fd >= 0) return fd;
  const std::filesystem::path named =
      folder / ("." + path.filename().string() + ".reserve." + std::to_string(::getpid()));
  const int created = ::open(named.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (created >= 0) ::unlink(named.c_str());
  return created;
}

}  // namespace

DiskReserve::DiskReserve(const std::filesystem::path& path) : fd_(open_without_name(path)) {}

DiskReserve::~DiskReserve() {
  if (fd_ < 0) return;
  (void)!::ftruncate(fd_, 0);
  ::close(fd_);
}

bool DiskReserve::grow_to(std::uint64_t bytes) {
  if (fd_ < 0) return true;
  while (bytes_ < bytes) {
    const ssize_t n = ::pwrite(fd_, ballast().data(), ballast().size(), static_cast<off_t>(bytes_));
    if (n < 0 && errno == EINTR) continue;
    if (n == 0) errno = ENOSPC;
    if (n <= 0) return false;
    bytes_ += static_cast<std::uint64_t>(n);
  }
  return true;
}

}  // namespace gnathion
