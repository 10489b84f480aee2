// When a file in a watched folder is complete: the rules, apart from the folder.
//
// A file is complete when its writer has closed it (or renamed it into place) and its size and time have
// stood still for a while; where the system tells no closing (network shares), when they have stood still for
// longer.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/time.h"

namespace gnathion {

/// What a directory listing says about a file.
struct FileState {
  std::uint64_t size = 0;
  std::int64_t modified_ns = 0;  ///< the file system's clock
  std::uint64_t inode = 0;
  std::int64_t status_ns = 0;  ///< rights, too: a file that becomes readable is looked at again
  std::string problem;         ///< not empty: it cannot be looked at
  auto operator<=>(const FileState&) const = default;
  bool same_content(const FileState& o) const {
    return size == o.size && modified_ns == o.modified_ns && inode == o.inode && problem == o.problem;
  }
};
using Listing = std::map<std::string, FileState>;  ///< by name without folder

/// What the system told about a file while it was written.
enum class FileEvent : std::uint8_t {
  kWritten,
  kClosed,
  kMovedIn,
  kLost,  ///< the system lost events: what was known of any file's writing is void
};

struct IntakeOptions {
  std::int64_t settle_ns = 300'000'000;           ///< after closing
  std::int64_t settle_unseen_ns = 2'000'000'000;  ///< without any word of the writer
  std::int64_t incomplete_ns = 60'000'000'000;    ///< then the file is given up until it changes
};

/// "face.obj.part", "~face.obj", "face.tmp", ".face.obj": still being written under another name.
bool is_temporary_name(const std::string& name);
/// .obj, .ply, .stl in any case.
bool is_mesh_name(const std::string& name);

/// Follows one folder. One thread.
class ScanIntake {
 public:
  explicit ScanIntake(IntakeOptions options) : options_(options) {}

  /// What is there now counts as known: it is offered only after it has changed.
  void ignore_present(const Listing& listing);
  void note(const std::string& name, FileEvent event);
  /// Takes what the folder looks like now.
  void update(const Listing& listing, HostTime now);
  /// Mesh files that are complete and wait for a verdict, oldest first.
  std::vector<std::string> ready(HostTime now) const;
  /// Any file (a texture too) that stands complete.
  bool is_settled(const std::string& name, HostTime now) const;
  bool exists(const std::string& name) const { return files_.count(name) > 0; }
  /// Mesh files given up because they never became complete, with the reason; each is told once for a state.
  struct GivenUp {
    std::string name, reason;
  };
  std::vector<GivenUp> overdue(HostTime now);

  /// The file's verdict has been spoken; it is offered again only when it changes.
  void close_case(const std::string& name);
  /// It is complete but no scan: it is offered again when it changes; `why` is told if it does not.
  void set_aside(const std::string& name, const std::string& why);
  /// Why it is not taken although it is offered (a texture is missing).
  void hold(const std::string& name, const std::string& why);
  std::optional<HostTime> last_change(const std::string& name) const;
  std::optional<HostTime> first_seen(const std::string& name) const;
  std::optional<FileState> state_of(const std::string& name) const;
  std::vector<std::string> waiting() const;  ///< mesh files on their way

 private:
  struct File {
    FileState state;
    HostTime first_seen, last_change;
    bool written = false;  ///< writing was seen since it was last closed
    bool closed = false;
    bool aside = false;  ///< not offered, but not done
    bool done = false;   ///< a verdict was spoken for this state
    bool given_up = false;
    std::string why;
  };
  bool settled(const File& file, HostTime now) const;
  IntakeOptions options_;
  std::map<std::string, File> files_;
  std::map<std::string, FileEvent> early_;  ///< events of files that no listing has shown yet
};

}  // namespace gnathion
