// Live instruments. A device is a source that waits for its instrument and comes back by itself after it was
// unplugged; nothing above can tell it from a recording.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "acquisition/clock_estimator.h"
#include "acquisition/device_config.h"
#include "core/source.h"
#include "core/time.h"

namespace gnathion {

enum class DeviceState : std::uint8_t { kStarting, kRunning, kRecovering, kFailed, kStopped };
/// "starting", "running", "recovering", "failed", "stopped".
const char* name_of(DeviceState state);

/// What a device tells of itself beside its samples.
struct DeviceHealth {
  DeviceState state = DeviceState::kStarting;
  std::string message;  ///< one line: what it waits for, why it failed
  std::uint64_t received = 0, rejected = 0, missing = 0, reconnects = 0;
  double rate_hz = 0;  ///< over the last two seconds
  ClockEstimate clock;
};

/// What a device is and how it was really set.
struct DeviceDescription {
  std::string kind, stream;           ///< as in the configuration
  std::string vendor, model, serial;  ///< as the instrument says; empty where it says nothing
  std::vector<std::string> settings;  ///< one line each: "exposure_us: 8000 (asked 8333)"
  std::vector<std::string> warnings;  ///< "rolling shutter: …"
};

/// next() blocks until a sample is there, the device has stopped (nothing) or failed for good (error). While
/// the instrument is away next() waits and tries to reconnect; loss and return come as EventSample of kind
/// "device" (pressed: true when it is back, text: why) on stream "<stream>/state". Raw transfers of USB and
/// HID devices come as TransferSample on "<stream>/raw", before the samples that were decoded from them.
/// next() is called by one thread; the other functions by any.
class Device : public Source {
 public:
  virtual DeviceDescription description() const = 0;
  virtual DeviceHealth health() const = 0;
  /// next() ends within 200 ms. Idempotent.
  virtual void stop() = 0;
};

using DeviceOpener = std::function<Result<std::unique_ptr<Device>>(const DeviceConfig&, Clock&)>;
/// Adds a kind that a layer above this one makes (the phantom). Before the first device is opened.
void add_device_kind(const std::string& kind, DeviceOpener opener);

/// Opens what the configuration asks for, or says in one line why not. `clock` outlives the device.
Result<std::unique_ptr<Device>> open_device(const DeviceConfig& config, Clock& clock);

}  // namespace gnathion
