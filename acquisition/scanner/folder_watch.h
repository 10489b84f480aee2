// What happens in a folder: listings always, the system's word about writing where there is one.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "acquisition/scanner/scan_intake.h"
#include "core/result.h"

namespace gnathion {

/// inotify on the folder (and its subfolders), or none: then listings alone tell. wake() from any thread, the
/// rest from one.
class FolderWatch {
 public:
  FolderWatch(std::filesystem::path folder, bool use_events, bool subfolders);
  ~FolderWatch();
  FolderWatch(const FolderWatch&) = delete;
  FolderWatch& operator=(const FolderWatch&) = delete;

  /// Until something happens in the folder, wake() is called, or the time is over.
  void wait(int milliseconds);
  void wake();
  /// What was told since the last call, in order. Call it before list(): an event then never speaks of a file
  /// that the listing is too old to show complete.
  std::vector<std::pair<std::string, FileEvent>> events();
  /// All regular files by name from the folder on ("scan_1/face.obj"), names beginning with '.' left out.
  /// Error: the folder is not there.
  Result<Listing> list();
  bool has_events() const { return inotify_ >= 0; }
  const std::string& why_no_events() const { return why_no_events_; }

 private:
  void watch(const std::string& subfolder);
  Status list_into(const std::string& subfolder, int depth, Listing& listing);
  std::filesystem::path folder_;
  bool subfolders_;
  int inotify_ = -1, wake_ = -1;
  std::string why_no_events_;
  std::map<int, std::string> watched_;  ///< descriptor → subfolder, "" for the folder itself
};

}  // namespace gnathion
