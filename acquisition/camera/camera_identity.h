// One camera must not be opened under two names.
#pragma once

#include <optional>
#include <vector>

#include "acquisition/device.h"

namespace gnathion {

/// For each configuration: an error where an earlier one names the same camera (serial, id, ip or source).
/// The earlier one may be opened.
std::vector<std::optional<Error>> cameras_named_twice(const std::vector<DeviceConfig>& configs);

/// An error where a device that is already open says it has the same serial number as `opened`: one camera
/// named in two ways, or two with one serial.
std::optional<Error> same_serial(const DeviceDescription& opened,
                                 const std::vector<DeviceDescription>& earlier);

}  // namespace gnathion
