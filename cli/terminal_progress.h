// A progress bar that names its steps, on a terminal; silent elsewhere, or if asked. For a job of the daemon:
// lines on a pipe, "S <share> <step>" when a step begins and "U <fraction>" as it goes on.
#pragma once

#include <string>

#include "core/progress.h"
#include "core/time.h"

namespace gnathion {

/// Writes to stderr, so that --json keeps stdout to itself.
class TerminalProgress : public Progress {
 public:
  enum class Mode { kSilent, kBar, kPipe };
  explicit TerminalProgress(Mode mode) : mode_(mode) {}
  ~TerminalProgress() override;
  void begin_step(std::string_view name, double share) override;
  void update(double fraction) override;

 private:
  void draw(double fraction);
  void finish_step();
  void send(const std::string& line) const;
  Mode mode_;
  std::string step_;
  double done_ = 0, share_ = 0;
  int last_percent_ = -1;
  Stopwatch step_time_;
};

/// The pipe that $GNATHION_PROGRESS_FD names; or a bar when stderr is a terminal and --quiet is not given.
TerminalProgress::Mode progress_mode(bool quiet);
/// A job of the daemon must not outlive it. Nothing for a command that a person has started.
void end_with_the_daemon();

}  // namespace gnathion
