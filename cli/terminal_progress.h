// A progress bar that names its steps, on a terminal; silent elsewhere, or if asked.
#pragma once

#include <string>

#include "core/progress.h"
#include "core/time.h"

namespace gnathion {

/// Writes to stderr, so that --json keeps stdout to itself.
class TerminalProgress : public Progress {
 public:
  enum class Mode { kSilent, kBar };
  explicit TerminalProgress(Mode mode) : mode_(mode) {}
  ~TerminalProgress() override;
  void begin_step(std::string_view name, double share) override;
  void update(double fraction) override;

 private:
  void draw(double fraction);
  void finish_step();
  Mode mode_;
  std::string step_;
  double done_ = 0, share_ = 0;
  int last_percent_ = -1;
  Stopwatch step_time_;
};

/// A bar when stderr is a terminal and --quiet is not given.
TerminalProgress::Mode progress_mode(bool quiet);

}  // namespace gnathion
