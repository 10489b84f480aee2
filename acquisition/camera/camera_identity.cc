#include "acquisition/camera/camera_identity.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr const char* kWhat = "cannot open camera";

/// What a configuration says of which camera it means: "serial" → "GV01".
std::map<std::string, std::string> identities(const DeviceConfig& config) {
  std::map<std::string, std::string> found;
  if (config.kind == "aravis")
    for (const char* key : {"serial", "id", "ip"})
      if (const auto it = config.settings.find(key); it != config.settings.end())
        if (const auto* text = std::get_if<std::string>(&it->second)) found[key] = *text;
  if (config.kind != "camera") return found;
  const auto it = config.settings.find("source");
  if (it == config.settings.end()) return found;
  std::string source;
  if (const auto* index = std::get_if<std::int64_t>(&it->second)) source = std::to_string(*index);
  if (const auto* text = std::get_if<std::string>(&it->second)) source = *text;
  const bool number = !source.empty() && source.find_first_not_of("0123456789") == std::string::npos;
  if (number) source = "/dev/video" + source;
  if (source.rfind("/dev/", 0) != 0) {
    // Two streams from one URL or file are possible, and harmless.
    return found;
  }
  std::error_code error;  // by-id links lead to the same node
  const fs::path node = fs::canonical(source, error);
  found["source"] = error ? source : node.string();
  return found;
}

}  // namespace

std::vector<std::optional<Error>> cameras_named_twice(const std::vector<DeviceConfig>& configs) {
  std::vector<std::optional<Error>> errors(configs.size());
  std::map<std::string, std::string> taken;  // "ip 10.0.0.2" → stream
  for (std::size_t i = 0; i < configs.size(); ++i) {
    const auto mine = identities(configs[i]);
    for (const auto& [key, value] : mine) {
      const auto other = taken.find(key + " " + value);
      if (other != taken.end() && !errors[i])
        errors[i] = Error{ErrorCode::kInput, kWhat, configs[i].where,
                          fmt::format("{} {} is already camera '{}'", key, value, other->second)};
    }
    if (errors[i]) continue;
    for (const auto& [key, value] : mine) taken[key + " " + value] = configs[i].stream;
  }
  return errors;
}

std::optional<Error> same_serial(const DeviceDescription& opened,
                                 const std::vector<DeviceDescription>& earlier) {
  if (opened.serial.empty()) return std::nullopt;
  const auto same = std::find_if(earlier.begin(), earlier.end(), [&](const DeviceDescription& d) {
    return d.kind == opened.kind && d.vendor == opened.vendor && d.model == opened.model &&
           d.serial == opened.serial;
  });
  if (same == earlier.end()) return std::nullopt;
  return Error{ErrorCode::kInput, kWhat, opened.stream,
               fmt::format("{} {} with serial {} is already '{}'", opened.vendor, opened.model, opened.serial,
                           same->stream)};
}

}  // namespace gnathion
