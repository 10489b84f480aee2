#include "viewer/model/session_state.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/transform_io.h"

namespace gnathion {
namespace {

using nlohmann::json;

std::string points_text(const std::vector<Vector3>& points_mm) {
  std::string out = "[";
  for (const Vector3& p : points_mm)
    out += fmt::format("{}[{:.4f}, {:.4f}, {:.4f}]", out.size() > 1 ? ", " : "", p.x(), p.y(), p.z());
  return out + "]";
}

json interval_json(const std::optional<std::pair<double, double>>& s) {
  return s ? json{s->first, s->second} : json(nullptr);
}

std::optional<std::pair<double, double>> interval_of(const json& j, const char* key) {
  if (!j.contains(key) || !j[key].is_array() || j[key].size() != 2) return std::nullopt;
  if (!j[key][0].is_number() || !j[key][1].is_number()) return std::nullopt;
  return std::pair{j[key][0].get<double>(), j[key][1].get<double>()};
}

}  // namespace

std::string edits_toml(const SplintEdits& edits) {
  constexpr const char* kKinds[] = {"add", "remove", "smooth"};
  std::string out = marks_toml(edits);
  for (const Stroke& s : edits.strokes)
    out += fmt::format(
        "[[design.stroke]]\nkind = \"{}\"\nradius_mm = {:.4f}\ndepth_mm = {:.4f}\npath_mm = {}\n",
        kKinds[static_cast<std::size_t>(s.kind)], s.radius_mm, s.depth_mm, points_text(s.path_mm));
  for (const Region& r : edits.cutouts)
    out += fmt::format("[[design.cutout]]\noutline_mm = {}\n", points_text(r.outline_mm));
  for (const Region& r : edits.contacts)
    out += fmt::format("[[design.contact]]\noutline_mm = {}\n", points_text(r.outline_mm));
  return out;
}

json session_json(const SessionState& state) {
  json j = {{"kind", "viewer"},
            {"unit", "mm"},
            {"therapeutic", nullptr},
            {"parameters", parameters_json(state.parameters)},
            {"edits_toml", edits_toml(state.edits)},
            {"arch", state.arch == Arch::kMaxilla ? "maxilla" : "mandible"},
            {"mi_s", interval_json(state.mi_s)},
            {"tp_s", interval_json(state.tp_s)}};
  if (state.therapeutic)
    j["therapeutic"] =
        motion_json(Motion<Dental>(*state.therapeutic), std::nullopt, {{"from", state.therapeutic_source}});
  return j;
}

Result<SessionState> session_from_json(const json& j, SessionState base) {
  const auto refuse = [](const std::string& why) {
    return bad_input("cannot restore the last session", "viewer.json", why);
  };
  if (!j.is_object() || j.value("kind", json()) != "viewer") return refuse("not a viewer's session");
  SessionState s = std::move(base);
  if (j.contains("therapeutic") && j["therapeutic"].is_object()) {
    GNATHION_TRY(const MotionFile motion, parse_motion(j["therapeutic"].dump(), "viewer.json"));
    s.therapeutic = motion.motion.rigid;
    const json& source = j["therapeutic"].contains("source") ? j["therapeutic"]["source"] : json();
    if (source.is_object() && source.contains("from") && source["from"].is_string())
      s.therapeutic_source = source["from"].get<std::string>();
  }
  if (j.contains("parameters") && j["parameters"].is_object())
    for (const auto& [name, value] : j["parameters"].items())
      if (value.is_number())
        GNATHION_CHECK_OK(
            set_parameter(s.parameters, fmt::format("design.{}={}", name, value.get<double>())));
  GNATHION_CHECK_OK(check_parameters(s.parameters));
  if (j.contains("edits_toml") && j["edits_toml"].is_string()) {
    GNATHION_TRY(s.edits, parse_edits(j["edits_toml"].get<std::string>(), "viewer.json"));
  }
  if (j.contains("arch")) s.arch = j["arch"] == "mandible" ? Arch::kMandible : Arch::kMaxilla;
  s.mi_s = interval_of(j, "mi_s");
  s.tp_s = interval_of(j, "tp_s");
  return s;
}

}  // namespace gnathion
