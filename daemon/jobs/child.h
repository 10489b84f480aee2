// One process of the `gnathion` program, with its progress on a pipe.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/result.h"

namespace gnathion::daemon {

struct ChildOrder {
  std::filesystem::path program;
  std::vector<std::string> arguments;
  std::filesystem::path work;  ///< its standard output, errors and temporary files go here
  int nice = 10;
};

struct ChildProgress {
  std::string step;
  double step_fraction = 0, fraction = 0;
};

struct ChildEnd {
  int pid = 0;
  int exit_code = -1;  ///< -1: ended by a signal
  int signal = 0;
  bool cancelled = false;
  std::string output;  ///< at most 16 MiB
  std::string error;   ///< its last line on stderr
};

/// Runs it to its end. `cancelled` is asked every 20 ms: when it says so the process group gets SIGTERM, and
/// SIGKILL 200 ms later. `report` gets what has changed. The child dies with the thread that called this.
Result<ChildEnd> run_child(const ChildOrder& order, const std::function<bool()>& cancelled,
                           const std::function<void(const ChildProgress&)>& report);

}  // namespace gnathion::daemon
