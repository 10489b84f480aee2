// Files that appear whole or not at all.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace gnathion {

/// Whole file as bytes.
Result<std::string> read_file(const std::filesystem::path& path);
/// Writes beside the target, syncs, renames over it: readers see the old file or the new one.
Status write_file(const std::filesystem::path& path, std::string_view bytes);
/// SHA-256 in lower-case hex.
std::string sha256_hex(std::string_view bytes);
Result<std::string> sha256_of_file(const std::filesystem::path& path);

/// A directory that is built beside its final place and appears there by rename. Dropped without
/// commit(), it is removed with all that was written into it.
class StagedDirectory {
 public:
  /// Refuses an existing `target` unless `force`; a forced target is replaced at commit(). Even forced, only
  /// a folder that holds one of `own_files` (or nothing) is replaced, and never the current directory.
  static Result<StagedDirectory> create(const std::filesystem::path& target, bool force,
                                        const std::vector<std::string>& own_files = {});
  ~StagedDirectory();
  StagedDirectory(StagedDirectory&& other) noexcept;
  StagedDirectory& operator=(StagedDirectory&&) = delete;

  const std::filesystem::path& path() const { return staging_; }
  Status commit();

 private:
  StagedDirectory(std::filesystem::path staging, std::filesystem::path target)
      : staging_(std::move(staging)), target_(std::move(target)) {}
  std::filesystem::path staging_, target_;
};

}  // namespace gnathion
