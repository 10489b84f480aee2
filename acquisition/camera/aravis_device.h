// Kind "aravis": GenICam cameras (GigE Vision, USB3 Vision) over Aravis.
#pragma once

#include <memory>

#include "acquisition/device.h"

namespace gnathion {

/// Chosen by `serial`, `id` or `ip`. Comes back by itself after its control was lost.
/// docs/devices/genicam-camera.md.
Result<std::unique_ptr<Device>> open_aravis_device(const DeviceConfig& config, Clock& clock);

}  // namespace gnathion
