// From devices.toml to a session: what the command line's capture and the daemon have in common.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "acquisition/session.h"

namespace gnathion {

/// devices.toml, read, with what it says about rigs taken out of the devices' settings.
struct CaptureSetup {
  std::vector<DeviceConfig> configs;
  std::vector<RigOptions> rigs;
  std::map<std::string, std::string> attachments;  ///< devices.toml without passwords, and files it names
};

/// Cameras with one `rig` are watched for frames of one instant: `rig_tolerance_ms` (4), `rig_time` = "host"
/// or "device" of its first camera. Nothing is opened yet.
Result<CaptureSetup> read_capture_setup(const std::filesystem::path& devices_toml);

/// Puts a file among the attachments; two of one name with different bytes are refused (kUsage).
Status attach_file(const std::filesystem::path& path, std::map<std::string, std::string>& attachments);

/// "rtsp://user:secret@host" without the secret: recordings are given away.
std::string without_passwords(const std::string& text);

struct OpenedDevices {
  std::vector<std::unique_ptr<Device>> devices;
  std::vector<std::string> failures;  ///< one line for each that could not be opened
  std::vector<std::string> warnings;
};
/// Opens what can be opened; a camera that is named twice is opened once.
OpenedDevices open_devices(const std::vector<DeviceConfig>& configs, Clock& clock);

}  // namespace gnathion
