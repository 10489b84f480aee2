// Every loop of the daemon says that it goes on; the watchdog is fed only while all of them do.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "core/time.h"

namespace gnathion::daemon {

struct LoopHealth {
  std::string name;
  double age_s = 0, limit_s = 0;
  bool well() const { return age_s <= limit_s; }
};

/// Thread-safe. `clock` outlives it.
class Heartbeats {
 public:
  explicit Heartbeats(Clock& clock) : clock_(clock) {}
  /// A loop begins; it must beat at least every `limit_s` until it ends.
  void begin(const std::string& name, double limit_s) {
    std::lock_guard lock(mutex_);
    loops_[name] = {clock_.now(), limit_s};
  }
  void beat(const std::string& name) {
    std::lock_guard lock(mutex_);
    if (const auto loop = loops_.find(name); loop != loops_.end()) loop->second.last = clock_.now();
  }
  void end(const std::string& name) {
    std::lock_guard lock(mutex_);
    loops_.erase(name);
  }
  std::vector<LoopHealth> health() const {
    std::lock_guard lock(mutex_);
    std::vector<LoopHealth> all;
    const HostTime now = clock_.now();
    for (const auto& [name, loop] : loops_) all.push_back({name, now.seconds_since(loop.last), loop.limit_s});
    return all;
  }

 private:
  struct Loop {
    HostTime last;
    double limit_s = 0;
  };
  Clock& clock_;
  mutable std::mutex mutex_;
  std::map<std::string, Loop> loops_;
};

}  // namespace gnathion::daemon
