#include "core/interrupt.h"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace gnathion {
namespace fs = std::filesystem;
namespace {

/// Never destroyed: objects may go after static ones have.
struct Registered {
  std::mutex mutex;
  std::vector<fs::path> paths;
};
Registered& registered() {
  static auto* const all = new Registered;
  return *all;
}

int to_cleaner = -1;  ///< a pipe: a signal handler may do little more than write into one

void on_signal(int signal) {
  const auto byte = static_cast<unsigned char>(signal);
  [[maybe_unused]] const ssize_t n = ::write(to_cleaner, &byte, 1);
}

/// Other threads still write: once a folder is gone nothing can be put into it.
void remove_wholly(const fs::path& path) {
  std::error_code ec;
  for (int i = 0; i < 20 && fs::exists(fs::symlink_status(path, ec)); ++i) fs::remove_all(path, ec);
}

[[noreturn]] void clean(int from) {
  unsigned char signal = SIGTERM;
  while (::read(from, &signal, 1) != 1) {
  }
  {
    const std::scoped_lock lock(registered().mutex);  // nothing new is begun meanwhile
    for (const fs::path& path : registered().paths) remove_wholly(path);
    ::signal(signal, SIG_DFL);
    ::kill(::getpid(), signal);
    while (true) ::pause();
  }
}

}  // namespace

void clean_up_when_interrupted() {
  int ends[2];
  if (to_cleaner >= 0 || ::pipe2(ends, O_CLOEXEC) != 0) return;
  to_cleaner = ends[1];
  std::thread([from = ends[0]] { clean(from); }).detach();
  struct sigaction action {
  }, before{};
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESTART;
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    ::sigaction(signal, nullptr, &before);
    if (before.sa_handler == SIG_DFL) ::sigaction(signal, &action, nullptr);  // nohup's stays
  }
}

void goes_when_interrupted(const fs::path& path) {
  const std::scoped_lock lock(registered().mutex);
  registered().paths.push_back(path);
}

void stays_when_interrupted(const fs::path& path) {
  InterruptsWait().stays(path);
}

InterruptsWait::InterruptsWait() : lock_(registered().mutex) {}

void InterruptsWait::stays(const fs::path& path) const {
  auto& paths = registered().paths;
  const auto found = std::find(paths.begin(), paths.end(), path);
  if (found != paths.end()) paths.erase(found);
}

}  // namespace gnathion
