// Foot pedals over HID: hands-free marks. docs/devices/pedal.md.
#pragma once

#include "acquisition/device.h"

namespace gnathion {

/// Marks come as EventSample on "<stream>".
Result<std::unique_ptr<Device>> open_pedal(const DeviceConfig& config, Clock& clock);
/// The transfers of a recording through the same decoder.
Result<std::unique_ptr<Device>> replay_pedal(const DeviceConfig& config, std::unique_ptr<Source> recording);

}  // namespace gnathion
