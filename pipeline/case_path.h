// Paths that come from a client of the daemon, held inside the case root.
#pragma once

#include <filesystem>
#include <string_view>

#include "core/result.h"

namespace gnathion {

enum class PathUse {
  kExisting,  ///< a file or folder that is there
  kNew        ///< its folder is there; it may be made, or replaced if it is no link
};

/// The folder that holds all cases. Thread-safe; only ever reads the file system.
class CaseRoot {
 public:
  /// Refused (kInput): what is not a folder. The root itself may be reached through links; they are resolved
  /// once, here.
  static Result<CaseRoot> open(const std::filesystem::path& root);

  /// Absolute, without links.
  const std::filesystem::path& path() const { return path_; }

  /// `given` is relative to the root, or absolute and inside it. Refused (kUsage): "..", a symbolic link at
  /// any place, what is neither file nor folder (a pipe, a device), a NUL or other control character, a name
  /// longer than the file system takes, what does not exist (or, for kNew, whose folder does not). The result
  /// is absolute. A link that is put there after the check is for the opener to refuse (O_NOFOLLOW).
  Result<std::filesystem::path> resolve(std::string_view given, PathUse use = PathUse::kExisting) const;

  /// The folder of one case: an id is a plain name and its folder lies directly in the root.
  /// kExisting also asks for its case.toml.
  Result<std::filesystem::path> case_folder(std::string_view id, PathUse use = PathUse::kExisting) const;

 private:
  explicit CaseRoot(std::filesystem::path path) : path_(std::move(path)) {}
  std::filesystem::path path_;
};

}  // namespace gnathion
