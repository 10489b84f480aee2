#include "acquisition/device_config.h"

#include <fmt/format.h>
#define TOML_EXCEPTIONS \
  0  // as everywhere: toml++ built both ways in one program has two layouts of one class
#include <toml++/toml.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "core/file.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr const char* kWhat = "cannot read device configuration";

bool is_stream_name(const std::string& name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-';
  });
}

std::optional<ConfigValue> value_of_array(const toml::array& array) {
  std::vector<double> numbers;
  std::vector<std::string> texts;
  for (const toml::node& node : array) {
    if (node.is_number())
      numbers.push_back(*node.value<double>());
    else if (node.is_string())
      texts.push_back(*node.value<std::string>());
  }
  if (numbers.size() == array.size()) return numbers;
  if (texts.size() == array.size()) return texts;
  return std::nullopt;
}

std::optional<ConfigValue> value_of(const toml::node& node) {
  if (const auto* b = node.as_boolean()) return b->get();
  if (const auto* i = node.as_integer()) return i->get();
  if (const auto* d = node.as_floating_point()) return d->get();
  if (const auto* s = node.as_string()) return s->get();
  if (const auto* a = node.as_array()) return value_of_array(*a);
  return std::nullopt;
}

/// Levenshtein distance, to name the key that was meant.
std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t keep = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({keep, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

std::string nearest(const std::string& key, const std::set<std::string>& known) {
  std::string best;
  std::size_t distance = key.size() / 2 + 1;
  for (const std::string& k : known)
    if (const std::size_t d = edit_distance(key, k); d < distance) {
      distance = d;
      best = k;
    }
  return best;
}

Result<DeviceConfig> device_from(const toml::table& table, const fs::path& path, std::size_t number) {
  const std::string here = fmt::format("{}: device {}", path.string(), number);
  DeviceConfig config;
  config.kind = table["kind"].value_or(std::string{});
  config.stream = table["name"].value_or(std::string{});
  if (config.kind.empty()) return bad_input(kWhat, here, "has no 'kind'");
  if (!is_stream_name(config.stream))
    return bad_input(kWhat, here, "needs a 'name' of letters, digits, '_' and '-'");
  config.where = fmt::format("{}: {}", path.string(), config.stream);
  config.folder = path.parent_path();
  for (const auto& [key, node] : table) {
    const std::string name(key.str());
    if (name == "kind" || name == "name") continue;
    const auto value = value_of(node);
    if (!value)
      return bad_input(kWhat, config.where, fmt::format("'{}' is neither a value nor a list of them", name));
    config.settings[name] = *value;
  }
  return config;
}

}  // namespace

Result<std::vector<DeviceConfig>> read_device_configs(const fs::path& path) {
  GNATHION_TRY(const std::string text, read_file(path));
  toml::parse_result parsed = toml::parse(text);
  if (!parsed)
    return bad_input(
        kWhat, path.string(),
        fmt::format("line {}: {}", parsed.error().source().begin.line, parsed.error().description()));
  const toml::table file = std::move(parsed).table();
  for (const auto& [key, node] : file)
    if (key.str() != "device")
      return bad_input(kWhat, path.string(), fmt::format("unknown key '{}'", key.str()));
  const toml::array* tables = file["device"].as_array();
  if (!tables || tables->empty()) return bad_input(kWhat, path.string(), "names no [[device]]");
  std::vector<DeviceConfig> configs;
  for (const toml::node& node : *tables) {
    const toml::table* table = node.as_table();
    if (!table) return bad_input(kWhat, path.string(), "'device' must be a list of tables: [[device]]");
    GNATHION_TRY(DeviceConfig config, device_from(*table, path, configs.size() + 1));
    for (const DeviceConfig& other : configs)
      if (other.stream == config.stream)
        return bad_input(kWhat, path.string(), fmt::format("two devices are named '{}'", config.stream));
    configs.push_back(std::move(config));
  }
  return configs;
}

template <class T>
std::optional<T> SettingsReader::take(const std::string& key, const char* type) {
  known_.insert(key);
  const auto found = config_.settings.find(key);
  if (found == config_.settings.end()) return std::nullopt;
  if (const T* value = std::get_if<T>(&found->second)) return *value;
  errors_.push_back(fmt::format("'{}' must be {}", key, type));
  return std::nullopt;
}

std::optional<double> SettingsReader::number(const std::string& key) {
  const auto found = config_.settings.find(key);
  if (found != config_.settings.end())
    if (const auto* i = std::get_if<std::int64_t>(&found->second)) {
      known_.insert(key);
      return static_cast<double>(*i);
    }
  return take<double>(key, "a number");
}
std::optional<std::int64_t> SettingsReader::integer(const std::string& key) {
  return take<std::int64_t>(key, "a whole number");
}
std::optional<bool> SettingsReader::flag(const std::string& key) {
  return take<bool>(key, "true or false");
}
std::optional<std::string> SettingsReader::text(const std::string& key) {
  return take<std::string>(key, "a text");
}
std::optional<std::vector<double>> SettingsReader::numbers(const std::string& key) {
  return take<std::vector<double>>(key, "a list of numbers");
}
std::optional<std::vector<std::string>> SettingsReader::texts(const std::string& key) {
  return take<std::vector<std::string>>(key, "a list of texts");
}

double SettingsReader::number_in(const std::string& key, double low, double high, double fallback) {
  const std::optional<double> value = number(key);
  if (!value) return fallback;
  if (*value >= low && *value <= high) return *value;  // false for NaN
  errors_.push_back(fmt::format("'{}' is {}; it must be within {} to {}", key, *value, low, high));
  return fallback;
}

std::string SettingsReader::choice(const std::string& key, const std::vector<std::string>& choices,
                                   const std::string& fallback) {
  const std::optional<std::string> value = text(key);
  if (!value) return fallback;
  if (std::find(choices.begin(), choices.end(), *value) != choices.end()) return *value;
  errors_.push_back(fmt::format("'{}' is '{}'; it must be one of {}", key, *value, fmt::join(choices, ", ")));
  return fallback;
}

std::optional<fs::path> SettingsReader::path(const std::string& key) {
  const std::optional<std::string> value = text(key);
  if (!value) return std::nullopt;
  const fs::path p(*value);
  return p.is_absolute() ? p : config_.folder / p;
}

void SettingsReader::refuse(const std::string& key, const std::string& why) {
  errors_.push_back(fmt::format("'{}' {}", key, why));
}

Status SettingsReader::finish() {
  constexpr const char* what = "cannot configure device";
  if (!errors_.empty()) return bad_input(what, config_.where, errors_.front());
  for (const auto& [key, value] : config_.settings) {
    if (known_.count(key)) continue;
    const std::string meant = nearest(key, known_);
    return bad_input(
        what, config_.where,
        fmt::format("unknown key '{}'{}", key, meant.empty() ? "" : fmt::format("; '{}' is meant?", meant)));
  }
  return {};
}

}  // namespace gnathion
