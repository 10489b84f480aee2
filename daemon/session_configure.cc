// A new devices.toml from a client.
#include "core/file.h"
#include "daemon/client_path.h"
#include "daemon/session_control_impl.h"

namespace gnathion::daemon {

namespace fs = std::filesystem;
namespace {

/// A client may name devices (/dev), addresses, and files of the case root; no other file of the machine.
ApiStatus paths_stay_inside(const CaptureSetup& setup, const CaseRoot& root) {
  const auto allowed = [&](const DeviceConfig& config, const std::string& text) {
    if (text.find("://") != std::string::npos) return text.rfind("file:", 0) != 0;
    const fs::path path = fs::path(text).is_absolute() ? fs::path(text) : config.folder / text;
    if (may_hold_identity(path)) return false;
    std::error_code ec;
    if (!fs::exists(fs::symlink_status(path, ec))) return !fs::path(text).is_absolute();
    return path.string().rfind("/dev/", 0) == 0 ? path.string().find("..") == std::string::npos
                                                : root.resolve(path.string()).has_value();
  };
  for (const DeviceConfig& config : setup.configs)
    for (const auto& [key, value] : config.settings) {
      std::vector<std::string> texts;
      if (const auto* text = std::get_if<std::string>(&value)) texts = {*text};
      if (const auto* list = std::get_if<std::vector<std::string>>(&value)) texts = *list;
      for (const std::string& text : texts)
        if (!allowed(config, text))
          return refuse(
              ApiCode::kPermissionDenied,
              fmt::format("{}: '{}' names '{}': files must lie in the case root", config.stream, key, text));
    }
  return {};
}

}  // namespace

ApiResult<std::vector<std::string>> SessionControl::configure(const std::string& devices_toml) {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const auto t = s.take(Event::kConfigure, lock);
  if (!t) return tl::unexpected(t.error());
  const fs::path trial = s.config.devices.string() + ".trial";
  if (const Status written = write_file(trial, devices_toml); !written) return refuse(written.error());
  const auto read = read_capture_setup(trial);
  std::error_code ec;
  const ApiStatus inside = read ? paths_stay_inside(*read, s.root) : ApiStatus();
  if (!read || !inside) fs::remove(trial, ec);
  if (!read) return refuse(read.error(), ApiCode::kInvalidArgument);
  if (!inside) return tl::unexpected(inside.error());
  fs::rename(trial, s.config.devices, ec);
  if (ec)
    return refuse(ApiCode::kInternal,
                  fmt::format("cannot replace {}: {}", s.config.devices.string(), ec.message()));
  std::vector<std::string> streams;
  for (const DeviceConfig& config : read->configs) streams.push_back(config.stream);
  return streams;
}

}  // namespace gnathion::daemon
