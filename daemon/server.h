// The daemon as a whole: what it owns, from start to an orderly end.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/result.h"
#include "core/time.h"
#include "daemon/config.h"

namespace gnathion::daemon {

class Daemon {
 public:
  /// Takes up the state folder (one daemon at a time), recovers what a crash cut off, and serves. `clock`
  /// outlives it.
  static Result<std::unique_ptr<Daemon>> start(const DaemonConfig& config, Clock& clock);
  /// Ends a recording properly, cancels jobs, lets clients go.
  ~Daemon();

  /// Every loop has gone on lately: the watchdog may be fed. If not, `why` names the loop.
  bool well(std::string* why) const;
  /// What can change while running changes; one line for each that waits for a restart.
  std::vector<std::string> reload(const DaemonConfig& config);
  int igtl_port() const;  ///< 0: no OpenIGTLink

 private:
  struct State;
  explicit Daemon(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace gnathion::daemon
