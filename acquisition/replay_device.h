// A recording, or any other source, as a live device: a session cannot tell it from an instrument.
#pragma once

#include <deque>
#include <memory>
#include <mutex>

#include "acquisition/device.h"
#include "acquisition/replay.h"

namespace gnathion {

class ReplayDevice : public Device {
 public:
  /// `speed`: 1 as it was, 2 twice as fast, 0 without waiting. `clock` outlives the device.
  ReplayDevice(std::unique_ptr<Source> source, DeviceDescription description, Clock& clock, double speed);

  Result<std::optional<Sample>> next() override;
  DeviceDescription description() const override { return description_; }
  DeviceHealth health() const override;
  void stop() override;

 private:
  void count(const Sample& sample);
  const DeviceDescription description_;
  ClockWaiter waiter_;
  std::unique_ptr<Source> source_;
  mutable std::mutex mutex_;  ///< of what follows
  DeviceHealth health_;
  std::deque<HostTime> arrivals_;  ///< of the last two seconds
  bool stopped_ = false;
};

/// kind = "replay": `path` of a recording, `speed` (default 1), `from_s` (default 0, seconds from its start).
Result<std::unique_ptr<Device>> open_replay_device(const DeviceConfig& config, Clock& clock);

}  // namespace gnathion
