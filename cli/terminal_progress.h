// A progress bar that names its steps: one line on a terminal, a line a step elsewhere, silent if asked.
#pragma once

#include <string>

#include "core/progress.h"
#include "core/time.h"

namespace gnathion {

/// Writes to stderr, so that --json keeps stdout to itself.
class TerminalProgress : public Progress {
 public:
  enum class Mode { kSilent, kLines, kBar };
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

/// Silent with --quiet; a bar when stderr is a terminal; else one line a step.
TerminalProgress::Mode progress_mode(bool quiet);

}  // namespace gnathion
