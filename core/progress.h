// How long work tells where it stands. Implementations: a terminal bar (cli), a job stream (daemon), silence.
#pragma once

#include <string_view>

namespace gnathion {

/// Called from one thread at a time.
class Progress {
 public:
  virtual ~Progress() = default;
  /// A named step begins; `share` is its expected part of the whole command, 0..1.
  virtual void begin_step(std::string_view name, double share) = 0;
  /// Fraction of the current step that is done, 0..1.
  virtual void update(double fraction) = 0;
};

class SilentProgress : public Progress {
 public:
  void begin_step(std::string_view, double) override {}
  void update(double) override {}
};

}  // namespace gnathion
