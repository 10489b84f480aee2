// From a device's clock to the host's: offset and drift by robust regression over arrival times.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "core/time.h"

namespace gnathion {

/// What is known of a device's clock. host_ns = device_ns + offset_ns + drift_ppm·1e-6·(device_ns −
/// reference_ns).
struct ClockEstimate {
  bool known = false;
  std::int64_t reference_ns = 0;  ///< device time at which offset_ns holds
  double offset_ns = 0;
  double drift_ppm = 0;
  double jitter_ms = 0;  ///< robust spread of the arrivals about the line
  std::uint64_t samples = 0, outliers = 0;
};

/// Feeds on pairs of device time and arrival. Arrivals are late by a constant latency plus jitter that is
/// never negative, and a few are very late; the estimate follows the bulk, so that host_from_device() moves
/// smoothly and never backwards. The constant latency cannot be seen from here: `latency_ns` (from the
/// configuration, or from a temporal calibration) is subtracted. A device clock that jumps (reset, wrap)
/// starts a new estimate. One thread at a time.
class ClockEstimator {
 public:
  struct Options {
    double window_s = 30;  ///< memory of the regression
    std::int64_t latency_ns = 0;
    double max_drift_ppm = 500;
  };
  ClockEstimator() : ClockEstimator(Options{}) {}
  explicit ClockEstimator(Options options);

  /// Takes the pair and returns the host's time of that device instant.
  HostTime add(DeviceTime device, HostTime arrival);
  /// The host's time of a device instant by what is known so far; nothing before the first pair.
  std::optional<HostTime> host_from_device(DeviceTime device) const;
  const ClockEstimate& estimate() const { return estimate_; }

 private:
  struct Pair {
    std::int64_t device_ns, arrival_ns;
  };
  void fit();
  Options options_;
  std::deque<Pair> pairs_;
  ClockEstimate estimate_;
  std::int64_t last_host_ns_ = INT64_MIN;
};

}  // namespace gnathion
