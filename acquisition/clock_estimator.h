// From a device's clock to the host's: offset and drift by robust regression over arrival times.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "core/time.h"

namespace gnathion {

/// What is known of a device's clock. host_ns = device_ns + offset_ns + drift_ppm·1e-6·(device_ns −
/// reference_ns).
struct ClockEstimate {
  bool known = false;
  std::int64_t reference_ns = 0;  ///< device time at which offset_ns holds
  double offset_ns = 0;
  double drift_ppm = 0;
  double jitter_ms = 0;  ///< robust spread (1.48 MAD) of the arrivals about the line
  std::uint64_t samples = 0, outliers = 0;
  std::uint64_t restarts = 0;  ///< how often the device's (or host's) clock jumped
};

/// Feeds on pairs of device time and arrival. Arrivals are late by a constant latency plus jitter that is
/// never negative, and a few are very late; the line follows the earliest arrivals, so that
/// host_from_device() moves smoothly and never backwards. The constant latency cannot be seen from here:
/// `latency_ns` (from the configuration, or from a temporal calibration) is subtracted. A device clock that
/// jumps (reset, wrap) starts a new estimate, which keeps what is known of the drift. add() costs O(1) but
/// for two regressions a second over at most 64 points. One thread at a time.
class ClockEstimator {
 public:
  struct Options {
    double window_s = 30;  ///< memory of the regression
    std::int64_t latency_ns = 0;
    double max_drift_ppm = 500;
    double jump_s = 0.5;  ///< a delay that changes by more is a clock that jumped, or a stalled transport
  };
  ClockEstimator() : ClockEstimator(Options{}) {}
  explicit ClockEstimator(Options options);

  /// Takes the pair and returns the host's time of that device instant: not after its arrival, and, as far as
  /// that allows, later than that of every pair before (also when device times repeat, go back or jump).
  HostTime add(DeviceTime device, HostTime arrival);
  /// The host's time of a device instant by what is known so far; nothing before the first pair.
  std::optional<HostTime> host_from_device(DeviceTime device) const;
  const ClockEstimate& estimate() const { return estimate_; }

 private:
  struct Point {
    std::int64_t device_ns, delay_ns;  ///< delay: arrival − device time
  };
  /// Pairs that do not fit, as long as they agree among themselves.
  struct Held {
    Point first, earliest;
    int count = 0;
  };
  enum class Kind { kUsual, kLate, kOdd, kJumped };
  Kind judge(Point pair, std::int64_t residual_ns);
  void restart(Point from);
  void take(Point pair, std::int64_t residual_ns);
  void drop_points_before_a_step();
  void fit();
  void fit_line();
  void fit_jitter();
  std::int64_t line_delay_ns(std::int64_t device_ns) const;
  HostTime monotone(std::int64_t candidate_ns, std::int64_t device_ns, std::int64_t arrival_ns);

  Options options_;
  std::deque<Point> points_;   ///< the earliest arrival of each stretch of time: what the regression sees
  std::optional<Point> open_;  ///< of the stretch that is not over yet
  std::int64_t open_begin_ns_ = 0;
  Held held_;
  std::vector<double> residuals_ms_;  ///< of the last pairs, a ring
  std::size_t next_residual_ = 0;
  double residual_median_ms_ = 0;
  double drift_prior_ppm_ = 0, drift_prior_sigma_ppm_ = 100;
  ClockEstimate estimate_;
  std::int64_t last_device_ns_ = 0;
  std::int64_t last_host_ns_ = INT64_MIN;
};

}  // namespace gnathion
