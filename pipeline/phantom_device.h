// The virtual patient as a live device: its cameras and its pedal, in a session like any instrument.
#pragma once

#include <memory>

#include "acquisition/device.h"

namespace gnathion {

/// Makes kind "phantom" known to open_device(). Call it once, early.
void add_phantom_device();

/// Keys: `seed` (1), `duration_s` (16), `rate_hz` (60), `drop_fraction` (0), `border_movements` (true),
/// `speed` (1; 0: without waiting). Streams as in the phantom's recordings ("camera_0", "pedal"), times from
/// the clock's present on. The patient takes seconds to make, inside this call.
Result<std::unique_ptr<Device>> open_phantom_device(const DeviceConfig& config, Clock& clock);

}  // namespace gnathion
