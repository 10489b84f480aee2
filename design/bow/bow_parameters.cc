#include "design/bow/bow_parameters.h"

#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include "core/file.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot read bow parameters";

struct Field {
  const char* name;
  double BowParameters::*member;
  double low, high;
};
constexpr Field kFields[] = {
    {"bonding_gap_mm", &BowParameters::bonding_gap_mm, 0.0, 0.5},
    {"clutch_thickness_mm", &BowParameters::clutch_thickness_mm, 1.2, 4.0},
    {"engagement_mm", &BowParameters::engagement_mm, 0.0, 0.2},
    {"rim_below_edge_mm", &BowParameters::rim_below_edge_mm, 0.2, 4.0},
    {"gingiva_distance_mm", &BowParameters::gingiva_distance_mm, 0.0, 3.0},
    {"flange_mm", &BowParameters::flange_mm, 0.0, 5.0},
    {"maxilla_clearance_mm", &BowParameters::maxilla_clearance_mm, 0.5, 3.0},
    {"stem_width_mm", &BowParameters::stem_width_mm, 6.0, 20.0},
    {"stem_height_mm", &BowParameters::stem_height_mm, 3.0, 10.0},
    {"carrier_distance_mm", &BowParameters::carrier_distance_mm, 35.0, 100.0},
    {"tag_side_mm", &BowParameters::tag_side_mm, 10.0, 40.0},
    {"sticker_thickness_mm", &BowParameters::sticker_thickness_mm, 0.0, 0.29},
    {"forehead_radius_mm", &BowParameters::forehead_radius_mm, 60.0, 140.0},
    {"opening_deg", &BowParameters::opening_deg, 0.0, 40.0},
    {"protrusion_mm", &BowParameters::protrusion_mm, 0.0, 12.0},
    {"protrusion_descent_deg", &BowParameters::protrusion_descent_deg, 0.0, 70.0},
    {"fine_mm", &BowParameters::fine_mm, 0.1, 0.4},
    {"density_g_per_cm3", &BowParameters::density_g_per_cm3, 0.5, 3.0},
};

}  // namespace

Result<BowParameters> parse_bow_parameters(std::string_view toml, const std::string& name,
                                           BowParameters base) {
  const toml::parse_result parsed = toml::parse(toml, name);
  if (!parsed)
    return bad_input(
        kWhat, name,
        fmt::format("line {}: {}", parsed.error().source().begin.line, parsed.error().description()));
  const toml::table* bow = parsed.table()["bow"].as_table();
  if (bow == nullptr) return bad_input(kWhat, name, "has no [bow] table");
  for (const auto& [key, node] : *bow) {
    const Field* field = nullptr;
    for (const Field& f : kFields)
      if (key.str() == f.name) field = &f;
    if (field == nullptr) return bad_input(kWhat, name, fmt::format("unknown key '{}'", key.str()));
    const auto value = node.value<double>();
    if (!value || !std::isfinite(*value) || *value < field->low || *value > field->high)
      return bad_input(kWhat, name,
                       fmt::format("{} must be a number in {}..{}", field->name, field->low, field->high));
    base.*(field->member) = *value;
  }
  return base;
}

Result<BowParameters> read_bow_parameters(const std::filesystem::path& toml, BowParameters base) {
  GNATHION_TRY(const std::string text, read_file(toml));
  return parse_bow_parameters(text, toml.string(), base);
}

nlohmann::json bow_parameters_json(const BowParameters& parameters) {
  nlohmann::json j;
  for (const Field& f : kFields) j[f.name] = parameters.*(f.member);
  return j;
}

}  // namespace gnathion
