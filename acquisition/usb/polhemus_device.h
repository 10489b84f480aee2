// Electromagnetic bow tracker: Polhemus Patriot and Liberty over USB. docs/devices/polhemus.md.
#pragma once

#include "acquisition/device.h"

namespace gnathion {

/// Poses of sensor N come on "<stream>/N".
Result<std::unique_ptr<Device>> open_polhemus(const DeviceConfig& config, Clock& clock);
/// The transfers of a recording through the same decoder.
Result<std::unique_ptr<Device>> replay_polhemus(const DeviceConfig& config,
                                                std::unique_ptr<Source> recording);

}  // namespace gnathion
