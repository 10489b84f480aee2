#include "acquisition/device.h"

#include <fmt/format.h>

#include "acquisition/camera/aravis_device.h"
#include "acquisition/camera/capture_device.h"
#include "acquisition/igtl/igtl_device.h"
#include "acquisition/replay_device.h"
#include "acquisition/scanner/scan_devices.h"
#include "acquisition/usb/pedal_device.h"
#include "acquisition/usb/polhemus_device.h"

namespace gnathion {
namespace {

/// Every kind of instrument, one line each.
std::map<std::string, DeviceOpener>& openers() {
  static std::map<std::string, DeviceOpener> table = {
      {"aravis", open_aravis_device},
      {"camera", open_capture_device},
      {"depth_camera", open_depth_camera},
      {"openigtlink", open_igtl_device},
      {"pedal", open_pedal},
      {"polhemus", open_polhemus},
      {"replay", open_replay_device},
      {"scan_folder", open_scan_folder},
      {"stereo_scanner", open_stereo_scanner},
  };
  return table;
}

}  // namespace

const char* name_of(DeviceState state) {
  switch (state) {
    case DeviceState::kStarting:
      return "starting";
    case DeviceState::kRunning:
      return "running";
    case DeviceState::kRecovering:
      return "recovering";
    case DeviceState::kFailed:
      return "failed";
    case DeviceState::kStopped:
      return "stopped";
  }
  return "unknown";
}

void add_device_kind(const std::string& kind, DeviceOpener opener) {
  openers()[kind] = std::move(opener);
}

Result<std::unique_ptr<Device>> open_device(const DeviceConfig& config, Clock& clock) {
  const auto found = openers().find(config.kind);
  if (found != openers().end()) return found->second(config, clock);
  std::vector<std::string> kinds;
  for (const auto& [kind, opener] : openers()) kinds.push_back(kind);
  return bad_input("cannot open device", config.where,
                   fmt::format("unknown kind '{}'; known are {}", config.kind, fmt::join(kinds, ", ")));
}

}  // namespace gnathion
