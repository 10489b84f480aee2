#include "acquisition/scanner/folder_watch.h"

#include <dirent.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace gnathion {
namespace {

constexpr int kDeepest = 3;                // exporters nest a folder a scan, seldom two
constexpr std::size_t kMostFiles = 20000;  // a watched home directory by mistake

FileState state_from(const struct stat& s) {
  FileState state;
  state.size = static_cast<std::uint64_t>(s.st_size);
  state.modified_ns = static_cast<std::int64_t>(s.st_mtim.tv_sec) * 1'000'000'000 + s.st_mtim.tv_nsec;
  state.inode = s.st_ino;
  state.status_ns = static_cast<std::int64_t>(s.st_ctim.tv_sec) * 1'000'000'000 + s.st_ctim.tv_nsec;
  return state;
}

}  // namespace

FolderWatch::FolderWatch(std::filesystem::path folder, bool use_events, bool subfolders)
    : folder_(std::move(folder)), subfolders_(subfolders), wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  if (!use_events) {
    why_no_events_ = "switched off";
    return;
  }
  inotify_ = ::inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
  if (inotify_ < 0) why_no_events_ = std::strerror(errno);
  watch("");
}

FolderWatch::~FolderWatch() {
  if (inotify_ >= 0) ::close(inotify_);
  if (wake_ >= 0) ::close(wake_);
}

void FolderWatch::watch(const std::string& subfolder) {
  if (inotify_ < 0) return;
  // A watch that is there already is returned again.
  const int descriptor =
      ::inotify_add_watch(inotify_, (folder_ / subfolder).c_str(),
                          IN_CREATE | IN_MODIFY | IN_CLOSE_WRITE | IN_MOVED_TO | IN_DELETE_SELF | IN_ONLYDIR);
  if (descriptor >= 0)
    watched_[descriptor] = subfolder;
  else if (errno != ENOENT)
    why_no_events_ = std::strerror(errno);
}

void FolderWatch::wait(int milliseconds) {
  std::array<pollfd, 2> fds = {pollfd{wake_, POLLIN, 0}, pollfd{inotify_, POLLIN, 0}};
  ::poll(fds.data(), inotify_ >= 0 ? 2 : 1, milliseconds);
  std::uint64_t count = 0;
  while (::read(wake_, &count, sizeof count) > 0) {
  }
}

void FolderWatch::wake() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(wake_, &one, sizeof one);
}

std::vector<std::pair<std::string, FileEvent>> FolderWatch::events() {
  std::vector<std::pair<std::string, FileEvent>> out;
  if (inotify_ < 0) return out;
  alignas(inotify_event) std::array<char, 16384> buffer;
  for (;;) {
    const ssize_t n = ::read(inotify_, buffer.data(), buffer.size());
    if (n <= 0) return out;
    for (std::size_t at = 0; at < static_cast<std::size_t>(n);) {
      inotify_event event;
      std::memcpy(&event, buffer.data() + at, sizeof event);
      const char* name = buffer.data() + at + sizeof event;
      at += sizeof event + event.len;
      if (event.mask & IN_IGNORED) watched_.erase(event.wd);  // the folder went away
      // An overflow loses events, not files: the listing shows them, and they settle the slower way.
      if (event.mask & IN_Q_OVERFLOW) out.emplace_back("", FileEvent::kLost);
      const auto folder = watched_.find(event.wd);
      if (folder == watched_.end() || event.len == 0 || (event.mask & IN_ISDIR)) continue;
      const std::string path = folder->second.empty() ? name : folder->second + "/" + name;
      if (event.mask & IN_CLOSE_WRITE)
        out.emplace_back(path, FileEvent::kClosed);
      else if (event.mask & IN_MOVED_TO)
        out.emplace_back(path, FileEvent::kMovedIn);
      else if (event.mask & IN_MODIFY)
        out.emplace_back(path, FileEvent::kWritten);
    }
  }
}

Status FolderWatch::list_into(const std::string& subfolder, int depth, Listing& listing) {
  const std::filesystem::path folder = folder_ / subfolder;
  DIR* dir = ::opendir(folder.c_str());
  if (!dir) return bad_input("cannot watch folder", folder.string(), std::strerror(errno));
  errno = 0;
  while (const dirent* entry = ::readdir(dir)) {
    const std::string name = entry->d_name;
    if (name.front() == '.') continue;
    const std::string path = subfolder.empty() ? name : subfolder + "/" + name;
    struct stat s;
    if (::stat((folder / name).c_str(), &s) != 0) {
      listing[path].problem = std::strerror(errno);
    } else if (S_ISREG(s.st_mode)) {
      listing[path] = state_from(s);
    } else if (S_ISDIR(s.st_mode) && entry->d_type != DT_LNK && subfolders_ && depth < kDeepest) {
      watch(path);
      // A subfolder that cannot be read or vanishes meanwhile does not hide its siblings.
      (void)list_into(path, depth + 1, listing);
    }
    if (listing.size() > kMostFiles) {
      ::closedir(dir);
      return bad_input("cannot watch folder", folder_.string(),
                       fmt::format("more than {} files in it; name the scanner's export folder", kMostFiles));
    }
    errno = 0;
  }
  const int error = errno;
  ::closedir(dir);
  if (error != 0) return bad_input("cannot watch folder", folder.string(), std::strerror(error));
  return {};
}

Result<Listing> FolderWatch::list() {
  watch("");
  Listing listing;
  GNATHION_CHECK_OK(list_into("", 0, listing));
  return listing;
}

}  // namespace gnathion
