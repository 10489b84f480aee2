// Time: integer nanoseconds; host and device time are different types. Nothing calls now(): a clock
// is passed.
#pragma once

#include <compare>
#include <cstdint>

namespace gnathion {

/// Nanoseconds on the host's clock (Unix epoch for live sessions, 0 at the start for the phantom).
struct HostTime {
  std::int64_t ns = 0;
  auto operator<=>(const HostTime&) const = default;
  double seconds_since(HostTime start) const { return static_cast<double>(ns - start.ns) * 1e-9; }
};

/// Nanoseconds on a device's own clock.
struct DeviceTime {
  std::int64_t ns = 0;
  auto operator<=>(const DeviceTime&) const = default;
};

/// Source of host time. Implementations are thread-safe.
class Clock {
 public:
  virtual ~Clock() = default;
  virtual HostTime now() = 0;
};

/// The system's time as it was when this was made, carried on by the steady clock: later corrections of the
/// system's time (NTP, by hand) do not make it jump or run back.
class SystemClock : public Clock {
 public:
  SystemClock();
  HostTime now() override;

 private:
  std::int64_t epoch_of_steady_ns_;
};

/// A clock that a test sets by hand.
class ManualClock : public Clock {
 public:
  explicit ManualClock(HostTime start = {}) : now_(start) {}
  HostTime now() override { return now_; }
  void set(HostTime t) { now_ = t; }

 private:
  HostTime now_;
};

/// Wall-clock stopwatch for stage timings in reports; never for decisions.
class Stopwatch {
 public:
  Stopwatch();
  double seconds() const;
  void restart();

 private:
  std::int64_t start_ns_;
};

/// Peak resident set of this process so far, MiB (VmHWM).
double peak_rss_mib();

}  // namespace gnathion
