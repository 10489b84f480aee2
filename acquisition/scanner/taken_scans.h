// Which scans were taken, and which were on their way, across restarts.
#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>

#include "core/result.h"

namespace gnathion {

/// SHA-256 → name of each scan that was handed over. The file holds a line each, "sha256  name", so that
/// `sha256sum` prints and people read the same.
class TakenScans {
 public:
  /// A missing file is an empty memory; one that is no such list is refused.
  static Result<TakenScans> load(const std::filesystem::path& file);
  /// Name under which the content was taken, or null.
  const std::string* find(const std::string& sha256) const;
  /// Remembers, and writes the file.
  Status add(const std::string& sha256, const std::string& name);

 private:
  std::filesystem::path file_;
  std::map<std::string, std::string> names_;
};

/// Files that were seen but are not yet in the list above: a name a line. The file is there only while there
/// are any; one that is found at the start was left by a program that died.
class ScansUnderway {
 public:
  static Result<ScansUnderway> load(const std::filesystem::path& file);
  const std::set<std::string>& names() const { return names_; }
  /// Writes the file, or removes it, when something has changed.
  Status set(std::set<std::string> names);

 private:
  std::filesystem::path file_;
  std::set<std::string> names_;
};

}  // namespace gnathion
