#include "design/printing/printer_profile.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include "core/file.h"

namespace gnathion {
namespace {

constexpr char kWhat[] = "cannot read printer profile";

/// One table of the profile, read key by key; what is left over is unknown.
class Table {
 public:
  Table(const toml::table& table, std::string where) : table_(table), where_(std::move(where)) {}

  void number(const char* key, double& value, double low, double high) {
    const toml::node* node = take(key);
    if (!node) return;
    const std::optional<double> read = node->value<double>();
    if (!read || !std::isfinite(*read) || *read < low || *read > high)
      complain(key, fmt::format("not a number from {} to {}", low, high));
    else
      value = *read;
  }
  void text(const char* key, std::string& value) {
    const toml::node* node = take(key);
    if (!node) return;
    const std::optional<std::string> read = node->value<std::string>();
    if (!read || read->empty())
      complain(key, "not a text");
    else
      value = *read;
  }
  void known(const char* key) { seen_.push_back(key); }
  bool has(const char* key) const { return table_.contains(key); }
  void complain(const std::string& key, const std::string& why) {
    if (error_.empty()) error_ = where_ + key + ": " + why;
  }
  /// The first fault, or nothing.
  std::string finished() {
    for (const auto& [key, node] : table_)
      if (std::find(seen_.begin(), seen_.end(), key.str()) == seen_.end())
        complain(std::string(key.str()), "no such key");
    return error_;
  }

 private:
  const toml::node* take(const char* key) {
    seen_.emplace_back(key);
    return table_.get(key);
  }
  const toml::table& table_;
  std::string where_, error_;
  std::vector<std::string> seen_;
};

std::string read_plate(const toml::table& table, PrinterProfile& profile) {
  Table t(table, "plate.");
  t.number("x_mm", profile.room_mm.x(), 20.0, 2000.0);
  t.number("y_mm", profile.room_mm.y(), 20.0, 2000.0);
  t.number("height_mm", profile.room_mm.z(), 10.0, 2000.0);
  t.number("margin_mm", profile.margin_mm, 0.0, 50.0);
  t.number("spacing_mm", profile.spacing_mm, 0.5, 50.0);
  t.number("lift_mm", profile.lift_mm, 0.0, 50.0);
  return t.finished();
}

std::string read_scale(const toml::table& table, PrinterProfile& profile) {
  Table t(table, "scale.");
  const char* axes[] = {"x", "y", "z"};
  for (int k = 0; k < 3; ++k) t.number(axes[k], profile.printed_scale[k], 0.9, 1.1);
  t.text("source", profile.scale_source);
  if (profile.scale_source.empty()) t.complain("source", "missing: how was the scale measured?");
  return t.finished();
}

std::string read_material(const toml::table& table, std::size_t index, PrinterProfile& profile) {
  PrintMaterial material;
  Table t(table, fmt::format("material {}: ", index + 1));
  t.text("name", material.name);
  t.number("gap_mm", material.gap_mm, 0.0, 0.5);
  t.text("source", material.source);
  if (material.name.empty()) t.complain("name", "missing");
  if (!t.has("gap_mm")) t.complain("gap_mm", "missing");
  if (material.source.empty()) t.complain("source", "missing: how was the gap found?");
  if (profile.material(material.name)) t.complain("name", "twice");
  profile.materials.push_back(std::move(material));
  return t.finished();
}

std::string read_all(const toml::table& table, PrinterProfile& profile) {
  Table t(table, "");
  t.text("name", profile.name);
  t.text("source", profile.source);
  t.number("self_supporting_deg", profile.self_supporting_deg, 5.0, 80.0);
  if (profile.name.empty()) t.complain("name", "missing");
  for (const char* key : {"plate", "scale", "material"}) t.known(key);
  const auto sub = [&](const char* key, auto&& read) {
    if (!t.has(key)) return std::string();
    const toml::table* inner = table[key].as_table();
    return inner ? read(*inner, profile) : fmt::format("{}: not a table", key);
  };
  if (std::string fault = sub("plate", read_plate); !fault.empty()) return fault;
  if (std::string fault = sub("scale", read_scale); !fault.empty()) return fault;
  if (t.has("material")) {
    const toml::array* list = table["material"].as_array();
    if (!list) return "material: not a list of tables ([[material]])";
    for (std::size_t i = 0; i < list->size(); ++i) {
      const toml::table* one = list->get(i)->as_table();
      if (!one) return "material: not a list of tables ([[material]])";
      if (std::string fault = read_material(*one, i, profile); !fault.empty()) return fault;
    }
  }
  return t.finished();
}

}  // namespace

const PrintMaterial* PrinterProfile::material(std::string_view wanted) const {
  const auto at = std::find_if(materials.begin(), materials.end(),
                               [&](const PrintMaterial& m) { return m.name == wanted; });
  return at == materials.end() ? nullptr : &*at;
}

Result<PrinterProfile> parse_printer_profile(std::string_view text, const std::string& name) {
  const toml::parse_result parsed = toml::parse(text, name);
  if (!parsed)
    return bad_input(kWhat, fmt::format("{}:{}", name, parsed.error().source().begin.line),
                     std::string(parsed.error().description()));
  PrinterProfile profile;
  const std::string fault = read_all(parsed.table(), profile);
  if (!fault.empty()) return bad_input(kWhat, name, fault);
  return profile;
}

Result<PrinterProfile> read_printer_profile(const std::filesystem::path& path) {
  GNATHION_TRY(const std::string text, read_file(path));
  return parse_printer_profile(text, path.string());
}

}  // namespace gnathion
