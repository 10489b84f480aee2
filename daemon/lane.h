// One open device: its own thread pulls it from Arm to Disarm, tells the live side, and hands each sample on
// to the recording, when there is one. The recording sees the lane as a device (LaneFeed), so that recordings
// begin and end while the instrument goes on.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>

#include "acquisition/device.h"
#include "acquisition/session_queue.h"
#include "daemon/live_types.h"

namespace gnathion::daemon {

/// Called from the lane's thread with each sample before it is recorded; `taken` is when the host had it.
using SampleTap = std::function<void(const Sample& sample, HostTime taken)>;

class Lane {
 public:
  /// Starts the thread. `clock` outlives the lane.
  Lane(std::unique_ptr<Device> device, SampleTap tap, Clock& clock);
  /// Stops the device. One that hangs is left behind, with its thread, after 3 s.
  ~Lane();

  /// The recording's side of this lane. One at a time: a new one ends the one before. Its queue takes
  /// `queue_bytes`; what does not fit is rejected with a ledger line "queue full" (session_queue.h).
  std::unique_ptr<Device> feed(std::size_t queue_bytes, std::size_t reserve_bytes);

  DeviceDescription description() const;
  DeviceHealth health() const;
  std::map<std::string, LiveCounts> counts() const;  ///< by stream
  bool ended() const;
  Device& device();

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace gnathion::daemon
