#include "pipeline/capture_setup.h"

#include <fmt/format.h>

#include <algorithm>
#include <regex>
#include <set>

#include "acquisition/camera/camera_identity.h"
#include "core/file.h"

namespace gnathion {

namespace fs = std::filesystem;

std::string without_passwords(const std::string& text) {
  static const std::regex password("(://[^\\s:/@\"']*):[^\\s/@\"']+@");
  return std::regex_replace(text, password, "$1:***@");
}

Status attach_file(const fs::path& path, std::map<std::string, std::string>& attachments) {
  GNATHION_TRY(std::string bytes, read_file(path));
  if (path.extension() == ".toml") bytes = without_passwords(bytes);
  const auto [known, added] = attachments.try_emplace(path.filename().string(), bytes);
  if (!added && known->second != bytes)
    return fail(ErrorCode::kUsage, "cannot attach", path.string(),
                "another attached file has that name; rename one of them");
  return {};
}

namespace {

/// Calibration files are settings that name an existing file of one of these kinds.
Status attach_files_of(const DeviceConfig& config, std::map<std::string, std::string>& attachments) {
  static const std::set<std::string> kinds = {".toml", ".json", ".yaml", ".yml", ".xml"};
  for (const auto& [key, value] : config.settings) {
    const auto* text = std::get_if<std::string>(&value);
    if (!text) continue;
    const fs::path path = fs::path(*text).is_absolute() ? fs::path(*text) : config.folder / *text;
    std::error_code ec;
    if (kinds.count(path.extension().string()) && fs::is_regular_file(path, ec))
      GNATHION_CHECK_OK(attach_file(path, attachments));
  }
  return {};
}

/// The keys are taken out: the devices do not know them.
Result<std::vector<RigOptions>> take_rigs(std::vector<DeviceConfig>& configs) {
  std::vector<RigOptions> rigs;
  for (DeviceConfig& config : configs) {
    if (config.kind != "camera" && config.kind != "aravis") continue;
    DeviceConfig own = config;
    std::erase_if(own.settings, [](const auto& entry) { return entry.first.rfind("rig", 0) != 0; });
    std::erase_if(config.settings, [&](const auto& entry) { return own.settings.count(entry.first) > 0; });
    SettingsReader reader(own);
    const std::string name = reader.text("rig").value_or("");
    const double tolerance_ms = reader.number_in("rig_tolerance_ms", 0.01, 100.0, 4.0);
    const std::string time = reader.choice("rig_time", {"host", "device"}, "host");
    GNATHION_CHECK_OK(reader.finish());
    if (name.empty()) continue;
    auto rig = std::find_if(rigs.begin(), rigs.end(), [&](const RigOptions& r) { return r.name == name; });
    if (rig == rigs.end()) {
      rigs.push_back({name, {}});
      rig = rigs.end() - 1;
      rig->sync.tolerance_ns = static_cast<std::int64_t>(1e6 * tolerance_ms);
      using TimeBase = RigSyncOptions::TimeBase;
      rig->sync.time_base = time == "device" ? TimeBase::kDeviceTime : TimeBase::kHostCapture;
    }
    rig->sync.streams.push_back(config.stream);
  }
  for (const RigOptions& rig : rigs)
    if (rig.sync.streams.size() < 2)
      return bad_input("cannot configure rig", rig.name, "has one camera; frames come in sets from two on");
  return rigs;
}

}  // namespace

Result<CaptureSetup> read_capture_setup(const fs::path& devices_toml) {
  CaptureSetup setup;
  GNATHION_TRY(setup.configs, read_device_configs(devices_toml));
  GNATHION_TRY(setup.rigs, take_rigs(setup.configs));
  GNATHION_CHECK_OK(attach_file(devices_toml, setup.attachments));
  for (const DeviceConfig& config : setup.configs)
    GNATHION_CHECK_OK(attach_files_of(config, setup.attachments));
  return setup;
}

OpenedDevices open_devices(const std::vector<DeviceConfig>& configs, Clock& clock) {
  OpenedDevices opened;
  std::vector<DeviceDescription> cameras;
  const auto twice = cameras_named_twice(configs);
  for (std::size_t i = 0; i < configs.size(); ++i) {
    const DeviceConfig& config = configs[i];
    if (twice[i]) {
      opened.failures.push_back(twice[i]->line());
      continue;
    }
    auto device = open_device(config, clock);
    if (!device) {
      opened.failures.push_back(device.error().line());
      continue;
    }
    // Webcams of a model often share one serial; their nodes tell them apart.
    if (config.kind == "aravis") {
      const DeviceDescription camera = (*device)->description();
      if (const auto same = same_serial(camera, cameras)) {
        opened.failures.push_back(same->line());
        continue;
      }
      cameras.push_back(camera);
    }
    for (const std::string& warning : (*device)->description().warnings)
      opened.warnings.push_back(fmt::format("warning: {}: {}", config.stream, warning));
    opened.devices.push_back(std::move(*device));
  }
  return opened;
}

}  // namespace gnathion
