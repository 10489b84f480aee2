#include "design/parameters.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include "core/file.h"

namespace gnathion {
namespace {

struct Field {
  const char* name;
  double SplintParameters::*member;
  const char* unit;
  double low, high;
  const char* source;
};

constexpr Field kFields[] = {
    {"voxel_mm", &SplintParameters::voxel_mm, "mm", 0.04, 0.5, "grid spacing; reference plugin 0.1"},
    {"wall_mm", &SplintParameters::wall_mm, "mm", 0.5, 4.0, "minimum wall; published side wall 1.0"},
    {"occlusal_thickness_mm", &SplintParameters::occlusal_thickness_mm, "mm", 0.5, 6.0,
     "over biting surfaces where there is room; published 1.5, advice 0.8-2.5"},
    {"gap_mm", &SplintParameters::gap_mm, "mm", 0.0, 0.5, "seat gap at the walls; PMID 31053289: 0.1 best"},
    {"stop_gap_mm", &SplintParameters::stop_gap_mm, "mm", 0.0, 0.5,
     "seat gap over occlusal surfaces; 0: seats on teeth"},
    {"stop_angle_deg", &SplintParameters::stop_angle_deg, "deg", 0.0, 80.0,
     "occlusal surfaces face -a within this"},
    {"engagement_mm", &SplintParameters::engagement_mm, "mm", 0.0, 0.5,
     "net engagement below the height of contour; published 0-0.05"},
    {"depth_mm", &SplintParameters::depth_mm, "mm", 1.0, 10.0, "cutting surface behind the occlusal level"},
    {"occlusion_clearance_mm", &SplintParameters::occlusion_clearance_mm, "mm", 0.0, 2.0,
     "to the mandible outside contacts; reference plugin 0.2"},
    {"aperture_limit_mm", &SplintParameters::aperture_limit_mm, "mm", 0.2, 2.0,
     "thinner walls become apertures; thinnest wall that prints"},
    {"stamp_height_mm", &SplintParameters::stamp_height_mm, "mm", 0.5, 6.0,
     "height of S_occ over the occlusal level"},
    {"imprint_depth_mm", &SplintParameters::imprint_depth_mm, "mm", 0.1, 5.0,
     "imprint of the opposing arch beyond the natural relief, at most: more would lock the jaw"},
    {"draft_deg", &SplintParameters::draft_deg, "deg", 0.0, 60.0, "draft of the stamp's side walls"},
    {"smoothing_mm", &SplintParameters::smoothing_mm, "mm", 0.3, 4.0, "radius of concave fillets outside"},
    {"rim_radius_mm", &SplintParameters::rim_radius_mm, "mm", 0.0, 0.5, "rounding of the rim"},
    {"first_tooth", &SplintParameters::first_tooth, "", 1.0, 7.0,
     "first covered tooth from the midline, both sides; more than 1: two pieces"},
    {"last_tooth", &SplintParameters::last_tooth, "", 2.0, 8.0, "last covered tooth; 3: an anterior splint"},
    {"insertion_search_deg", &SplintParameters::insertion_search_deg, "deg", 0.0, 25.0,
     "seating direction: least undercut within this of the occlusal normal; 0: as given"},
    {"insertion_left_deg", &SplintParameters::insertion_left_deg, "deg", -25.0, 25.0,
     "start of that search, tilted to the patient's left"},
    {"insertion_anterior_deg", &SplintParameters::insertion_anterior_deg, "deg", -25.0, 25.0, "and forward"},
    {"excursion_mm", &SplintParameters::excursion_mm, "mm", 0.0, 12.0,
     "straight excursions from TP that run free where no motion is given; 0: none"},
    {"protrusion_deg", &SplintParameters::protrusion_deg, "deg", 0.0, 70.0, "their way down, forwards"},
    {"laterotrusion_deg", &SplintParameters::laterotrusion_deg, "deg", 0.0, 60.0,
     "their way down, sidewards"},
    {"disclusion_mm", &SplintParameters::disclusion_mm, "mm", 0.0, 2.0,
     "distance kept on excursions, from 2 mm of way on"},
    {"flat_plane", &SplintParameters::flat_plane, "", 0.0, 2.0,
     "0 positioning; flat plane parallel to the occlusal plane (1), by least clearance (2)"},
    {"plane_indent_mm", &SplintParameters::plane_indent_mm, "mm", 0.0, 1.0,
     "flat plane: no tip of canines to molars goes deeper"},
    {"canine_ramp_deg", &SplintParameters::canine_ramp_deg, "deg", 5.0, 60.0, "flat plane: canine guidance"},
    {"canine_ramp_mm", &SplintParameters::canine_ramp_mm, "mm", 0.0, 5.0, "its length; 0: none"},
    {"anterior_ramp_deg", &SplintParameters::anterior_ramp_deg, "deg", 5.0, 60.0,
     "flat plane: anterior guidance"},
    {"anterior_ramp_mm", &SplintParameters::anterior_ramp_mm, "mm", 0.0, 5.0, "its length; 0: none"},
    {"embrasure_mm", &SplintParameters::embrasure_mm, "mm", 0.0, 2.0,
     "grooves narrower than twice this stay empty"},
};

const Field* find_field(std::string_view name) {
  const auto* it =
      std::find_if(std::begin(kFields), std::end(kFields), [&](const Field& f) { return name == f.name; });
  return it == std::end(kFields) ? nullptr : it;
}

}  // namespace

Status check_parameters(const SplintParameters& parameters) {
  const auto refuse = [](const std::string& name, const std::string& why) {
    return fail(ErrorCode::kUsage, "cannot design", "design." + name, why);
  };
  for (const Field& f : kFields) {
    const double v = parameters.*f.member;
    if (!std::isfinite(v) || v < f.low || v > f.high)
      return refuse(f.name, fmt::format("{} is outside {} to {} {}", v, f.low, f.high, f.unit));
  }
  for (const double tooth : {parameters.first_tooth, parameters.last_tooth})
    if (tooth != std::round(tooth)) return refuse("first_tooth, last_tooth", "not whole numbers");
  if (parameters.flat_plane != std::round(parameters.flat_plane))
    return refuse("flat_plane", "not 0, 1 or 2");
  if (parameters.first_tooth >= parameters.last_tooth)
    return refuse("first_tooth", "not before the last covered tooth (design.last_tooth)");
  if (parameters.aperture_limit_mm > parameters.wall_mm)
    return refuse("aperture_limit_mm", "larger than the wall (design.wall_mm)");
  if (parameters.rim_radius_mm > 0.5 * parameters.wall_mm)
    return refuse("rim_radius_mm", "larger than half the wall (design.wall_mm)");
  if (parameters.voxel_mm > 0.5 * parameters.aperture_limit_mm)
    return refuse("voxel_mm", "larger than half the aperture limit (design.aperture_limit_mm)");
  return {};
}

Result<SplintParameters> parse_parameters(std::string_view text, const std::string& name,
                                          SplintParameters base) {
  const toml::parse_result parsed = toml::parse(text, name);
  if (!parsed) {
    const auto& error = parsed.error();
    return bad_input("cannot read parameters", fmt::format("{}:{}", name, error.source().begin.line),
                     std::string(error.description()));
  }
  const toml::table* design = parsed.table()["design"].as_table();
  if (!design) return base;
  for (const auto& [key, node] : *design) {
    const std::string where = fmt::format("{}: design.{}", name, std::string_view(key.str()));
    const bool edit = key.str() == "stroke" || key.str() == "cutout" || key.str() == "contact" ||
                      key.str() == "tooth" || key.str() == "margin" || key.str() == "label";
    if (edit) continue;  // edits.h
    const Field* field = find_field(key.str());
    if (!field) return bad_input("cannot read parameters", where, "no such parameter");
    const std::optional<double> value = node.value<double>();
    if (!value) return bad_input("cannot read parameters", where, "not a number");
    base.*field->member = *value;
  }
  const Status status = check_parameters(base);
  if (!status)
    return bad_input("cannot read parameters", name + ": " + status.error().where, status.error().why);
  return base;
}

Result<SplintParameters> read_parameters(const std::filesystem::path& path, SplintParameters base) {
  GNATHION_TRY(const std::string text, read_file(path));
  return parse_parameters(text, path.string(), base);
}

Status set_parameter(SplintParameters& parameters, std::string_view key_equals_value) {
  const auto refuse = [&](const std::string& why) {
    return fail(ErrorCode::kUsage, "cannot set parameter", std::string(key_equals_value), why);
  };
  const std::size_t equals = key_equals_value.find('=');
  if (equals == std::string_view::npos) return refuse("expected design.NAME=VALUE");
  std::string_view key = key_equals_value.substr(0, equals);
  const std::string_view value = key_equals_value.substr(equals + 1);
  constexpr std::string_view prefix = "design.";
  if (key.substr(0, prefix.size()) != prefix) return refuse("expected design.NAME=VALUE");
  const Field* field = find_field(key.substr(prefix.size()));
  if (!field) return refuse("no such parameter");
  double number = 0.0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
  if (error != std::errc() || end != value.data() + value.size()) return refuse("not a number");
  if (!(number >= field->low && number <= field->high))
    return refuse(fmt::format("outside {} to {} {}", field->low, field->high, field->unit));
  parameters.*field->member = number;
  return {};
}

nlohmann::json parameters_json(const SplintParameters& parameters) {
  nlohmann::json j = nlohmann::json::object();
  for (const Field& f : kFields) j[f.name] = parameters.*f.member;
  return j;
}

std::vector<ParameterHelp> parameter_help() {
  const SplintParameters defaults;
  std::vector<ParameterHelp> out;
  for (const Field& f : kFields) out.push_back({f.name, f.unit, f.source, defaults.*f.member, f.low, f.high});
  return out;
}

}  // namespace gnathion
