// What a session writes about itself into its recording.
#pragma once

#include <string>

#include "acquisition/session.h"

namespace gnathion {

/// session.json: software version, policies, and every device as it was really set.
std::string session_start_json(const SessionOptions& options, const std::vector<DeviceDescription>& devices);
/// session_end.json: what became of the devices, their clocks, the queue and the disk.
std::string session_end_json(const SessionStatus& status);

}  // namespace gnathion
