#include "acquisition/clock_estimator.h"

namespace gnathion {

ClockEstimator::ClockEstimator(Options options) : options_(options) {}

HostTime ClockEstimator::add(DeviceTime device, HostTime arrival) {
  pairs_.push_back({device.ns, arrival.ns});
  fit();
  return {arrival.ns - options_.latency_ns};
}

std::optional<HostTime> ClockEstimator::host_from_device(DeviceTime device) const {
  if (!estimate_.known) return std::nullopt;
  return HostTime{device.ns + static_cast<std::int64_t>(estimate_.offset_ns)};
}

void ClockEstimator::fit() {}

}  // namespace gnathion
