// Disk space kept back, so that a recording can be ended properly when the disk is full.
#pragma once

#include <cstdint>
#include <filesystem>

namespace gnathion {

/// A file without a name beside `path`; its space returns to the disk when this object goes, or the process.
class DiskReserve {
 public:
  explicit DiskReserve(const std::filesystem::path& path);
  ~DiskReserve();
  DiskReserve(const DiskReserve&) = delete;
  DiskReserve& operator=(const DiskReserve&) = delete;

  /// Really holds at least `bytes`. False (errno tells why) when the disk has no room for it; true where the
  /// folder allows no such file.
  bool grow_to(std::uint64_t bytes);
  std::uint64_t bytes() const { return bytes_; }

 private:
  int fd_ = -1;
  std::uint64_t bytes_ = 0;
};

}  // namespace gnathion
