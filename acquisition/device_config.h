// devices.toml: which instruments a session has, and how each is set.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "core/result.h"

namespace gnathion {

using ConfigValue =
    std::variant<bool, std::int64_t, double, std::string, std::vector<double>, std::vector<std::string>>;

/// One [[device]] table: its kind, its stream's name, and every other key as it stands.
struct DeviceConfig {
  std::string kind;    ///< "camera", "aravis", "polhemus", "pedal", "scan_folder", "stereo_scanner",
                       ///< "depth_camera", "openigtlink"
  std::string stream;  ///< key `name`: letters, digits, '_' and '-'
  std::map<std::string, ConfigValue> settings;
  std::string where;             ///< "devices.toml: camera_0", for messages
  std::filesystem::path folder;  ///< of the file: relative paths start here
};

/// Refuses a file that is not TOML, a device without kind or name, and two devices of one name.
Result<std::vector<DeviceConfig>> read_device_configs(const std::filesystem::path& path);

/// Takes settings one by one, remembering which were asked for, so that a key that no one knows is an error
/// and not a silent default. Errors are collected; finish() tells the first.
class SettingsReader {
 public:
  explicit SettingsReader(const DeviceConfig& config) : config_(config) {}
  std::optional<double> number(const std::string& key);  ///< integers too
  std::optional<std::int64_t> integer(const std::string& key);
  std::optional<bool> flag(const std::string& key);
  std::optional<std::string> text(const std::string& key);
  std::optional<std::vector<double>> numbers(const std::string& key);
  std::optional<std::vector<std::string>> texts(const std::string& key);
  /// A number within [low, high], or `fallback` where the key is not there.
  double number_in(const std::string& key, double low, double high, double fallback);
  /// One of `choices`, or `fallback`.
  std::string choice(const std::string& key, const std::vector<std::string>& choices,
                     const std::string& fallback);
  /// A path, relative ones made absolute from the file's folder.
  std::optional<std::filesystem::path> path(const std::string& key);
  /// Says that a combination of settings is not possible.
  void refuse(const std::string& key, const std::string& why);
  /// The first error: a key of the wrong type or out of range, then a key that does not exist (with the
  /// nearest that does).
  Status finish();

 private:
  template <class T>
  std::optional<T> take(const std::string& key, const char* type);
  const DeviceConfig& config_;
  std::set<std::string> known_;
  std::vector<std::string> errors_;
};

}  // namespace gnathion
