// OpenIGTLink client: poses, images, surfaces and states from PLUS, 3D Slicer or any tracker that speaks it.
// docs/devices/openigtlink.md.
#pragma once

#include <memory>

#include "acquisition/device.h"

namespace gnathion {

/// Kind "openigtlink". The first connection is made by next(), not here: a server that is not there yet is
/// waited for. Streams: poses on "<name>/<device or tool>", images on "<name>/<device>/image", surfaces on
/// "<name>/<device>/scan", STATUS on "<name>/<device>/status".
Result<std::unique_ptr<Device>> open_igtl_device(const DeviceConfig& config, Clock& clock);

}  // namespace gnathion
