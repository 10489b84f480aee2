// Replay at a pace: a decorator around any source. Replay itself is pulled and never slept (RecordingSource).
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>

#include "core/source.h"
#include "core/time.h"

namespace gnathion {

/// Waits for a time of day on some clock. Members are thread-safe.
class Waiter {
 public:
  virtual ~Waiter() = default;
  /// Returns at `time` or later; false when it was cancelled before.
  virtual bool wait_until(HostTime time) = 0;
};

/// Sleeps on the clock that it is given (the system's); cancel() wakes it for good.
class ClockWaiter : public Waiter {
 public:
  explicit ClockWaiter(Clock& clock) : clock_(clock) {}
  bool wait_until(HostTime time) override;
  void cancel();

 private:
  Clock& clock_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool cancelled_ = false;
};

/// Hands on the samples of `source` unchanged, each when its arrival time has come: the first at once, the
/// others as far behind it as they arrived, divided by `speed` (1: as it was, 2: twice as fast). Samples that
/// are late are not dropped. Ends when the waiter is cancelled. Clock and waiter outlive it.
class PacedSource : public Source {
 public:
  PacedSource(std::unique_ptr<Source> source, Clock& clock, Waiter& waiter, double speed = 1.0);
  Result<std::optional<Sample>> next() override;

 private:
  std::unique_ptr<Source> source_;
  Clock& clock_;
  Waiter& waiter_;
  double speed_;
  std::optional<HostTime> first_arrival_;
  HostTime started_;
};

}  // namespace gnathion
