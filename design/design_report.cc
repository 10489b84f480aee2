#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/transform_io.h"
#include "design/label.h"
#include "design/splint.h"

namespace gnathion {
namespace {

using nlohmann::json;

json point(const Vector3& p) {
  return {p.x(), p.y(), p.z()};
}

json mesh_facts(const SplintVerification& v) {
  return {{"vertices", v.topology.vertices},     {"triangles", v.topology.triangles},
          {"components", v.topology.components}, {"watertight", v.topology.watertight()},
          {"manifold", v.topology.manifold()},   {"self_intersections", v.self_intersections},
          {"genus", v.topology.genus},           {"volume_mm3", v.volume_mm3}};
}

json contact_facts(const SplintVerification& v) {
  json per_tooth = json::array(), patches = json::array();
  for (std::size_t i = 0; i < v.contacts.per_tooth.size(); ++i) {
    const ToothArea& tooth = v.contacts.per_tooth[i];
    json entry = {{"fdi", tooth.fdi}, {"area_mm2", tooth.area_mm2}};
    if (v.contact_sigma) {
      entry["gap_sigma_mm"] = v.contact_sigma->per_tooth[i].sigma_mm;
      entry["gap_sigma_largest_mm"] = v.contact_sigma->per_tooth[i].largest_mm;
    }
    per_tooth.push_back(std::move(entry));
  }
  for (std::size_t i = 0; i < v.contacts.patches.size(); ++i) {
    const ContactPatch& patch = v.contacts.patches[i];
    json entry = {{"fdi", patch.fdi}, {"area_mm2", patch.area_mm2}, {"centre_mm", point(patch.centre_mm)}};
    if (v.contact_sigma) entry["gap_sigma_mm"] = v.contact_sigma->patches_mm[i];
    patches.push_back(std::move(entry));
  }
  return {{"count", v.contacts.patches.size()},
          {"patches", patches},
          {"area_mm2", v.contacts.area_mm2},
          {"left_area_mm2", v.contacts.left_area_mm2},
          {"right_area_mm2", v.contacts.right_area_mm2},
          {"front_area_mm2", v.contacts.front_area_mm2},
          {"natural_area_mm2", v.natural_contact_area_mm2},
          {"kept_fraction", v.kept_fraction},
          {"kept_outside_apertures", v.kept_outside_apertures},
          {"per_tooth", per_tooth}};
}

json aperture_facts(const std::vector<Aperture>& apertures) {
  json out = json::array();
  for (const Aperture& a : apertures)
    out.push_back({{"area_mm2", a.area_mm2},
                   {"centre_mm", point(a.centre_mm)},
                   {"teeth", a.teeth},
                   {"cause", a.cause}});
  return out;
}

json insertability_facts(const SplintVerification& v) {
  return {{"deepest_mm", v.insertability.deepest_mm},
          {"before_seat_mm", v.insertability.before_seat_mm},
          {"where_mm", point(v.insertability.where_mm)},
          {"teeth", v.insertability.teeth}};
}

json imprint_facts(const SplintVerification& v) {
  json places = json::array();
  for (const auto& place : v.imprint.held_by_wall)
    places.push_back({{"depth_mm", place.depth_mm},
                      {"area_mm2", place.area_mm2},
                      {"where_mm", point(place.where_mm)},
                      {"teeth", place.teeth}});
  return {{"avoidable_mm", v.imprint.avoidable_mm},
          {"held_by_wall", places},
          {"depth_mm", v.imprint.depth_mm},
          {"where_mm", point(v.imprint.deepest_where_mm)},
          {"undercut_mm", v.imprint.undercut_mm},
          {"undercut_where_mm", point(v.imprint.undercut_where_mm)},
          {"opening_path", "straight along the occlusal normal"}};
}

json freedom_facts(const SplintVerification& v) {
  if (!v.freedom) return nullptr;
  return {{"poses", v.freedom->poses}, {"deepest_mm", v.freedom->deepest_mm}};
}

json seating_facts(const std::optional<PredictedSeating>& seating) {
  if (!seating) return nullptr;
  return {{"alpha_deg", seating->alpha_deg},
          {"t_mm", seating->t_mm},
          {"max_tooth_mm", seating->max_tooth_mm},
          {"splint_mm", seating->splint_mm},
          {"bite_mm", seating->bite_mm},
          {"natural_mm", seating->natural_mm},
          {"play_mm", seating->play_mm}};
}

json label_facts(const std::optional<EmbossedLabel>& label) {
  if (!label) return nullptr;
  return {{"text", label->text},           {"side", label->buccal ? "buccal" : "oral"},
          {"letter_mm", label->letter_mm}, {"width_mm", label->width_mm},
          {"proud_mm", Label::kProudMm},   {"centre_mm", point(label->centre_mm)}};
}

const char* arch_name(Arch arch) {
  return arch == Arch::kMaxilla ? "maxilla" : "mandible";
}

json insertion_facts(const SplintDesign& design) {
  const Insertion& i = design.insertion;
  return {{"direction", point(i.direction)},
          {"tilt_deg", i.tilt_deg},
          {"undercut_mm3", i.undercut_mm3},
          {"undercut_at_normal_mm3", i.undercut_at_normal_mm3},
          {"retention_area_mm2", design.verification.retention_area_mm2}};
}

json input_facts(const std::vector<InputRecord>& inputs) {
  json out = json::array();
  for (const InputRecord& i : inputs) out.push_back({{"path", i.path}, {"sha256", i.sha256}});
  return out;
}

}  // namespace

json design_json(const SplintDesign& design, const std::vector<InputRecord>& inputs,
                 const std::string& version, double total_s, double peak_rss_mib) {
  const SplintVerification& v = design.verification;
  json timing = {{"total", total_s}};
  for (const auto& [stage, seconds] : design.timing_s) timing[stage] = seconds;
  json gates = json::array();
  for (const Gate& g : design.gates)
    gates.push_back(
        {{"name", g.name}, {"value", g.value}, {"limit", g.limit}, {"pass", g.pass}, {"blocks", g.blocks}});
  return {{"verdict", design.verdict},
          {"violated", design.violated},
          {"parameters", parameters_json(design.parameters)},
          {"inputs", input_facts(inputs)},
          {"version", version},
          {"timing_s", timing},
          {"peak_rss_mib", peak_rss_mib},
          {"mesh", mesh_facts(v)},
          {"thickness_mm",
           {{"min", v.thickness.min_mm},
            {"p01", v.thickness.p01_mm},
            {"median", v.thickness.median_mm},
            {"where_mm", point(v.thickness.where_mm)}}},
          {"seat_gap_mm",
           {{"min", v.seat_gap.min_mm}, {"median", v.seat_gap.median_mm}, {"max", v.seat_gap.max_mm}}},
          {"edits", edits_json(design.edits)},
          {"label", label_facts(design.label)},
          {"flat_plane", design.flat ? flat_plane_json(*design.flat, design.dental_from_design) : json()},
          {"arch", arch_name(design.worn_on)},
          {"insertion", insertion_facts(design)},
          {"maxilla_penetration_mm", v.maxilla_penetration_mm},
          {"mandible_penetration_mm", v.mandible_penetration_mm},
          {"contacts", contact_facts(v)},
          {"contact_surface_error_mm",
           {{"mean_abs", v.contact_surface_error.mean_abs_mm},
            {"p99", v.contact_surface_error.p99_mm},
            {"max", v.contact_surface_error.max_mm}}},
          {"apertures", aperture_facts(v.apertures)},
          {"thin_under_contact_mm2", v.thin_under_contact_mm2},
          {"retention", retention_json(v.retention)},
          {"insertability", insertability_facts(v)},
          {"imprint", imprint_facts(v)},
          {"bite", bite_json(v.bite)},
          {"build",
           {{"up", point(v.build.up)},
            {"overhang_mm2", v.build.overhang_mm2},
            {"cavity_overhang_mm2", v.build.cavity_overhang_mm2}}},
          {"freedom", freedom_facts(v)},
          {"predicted_seating", seating_facts(v.predicted_seating)},
          {"gates", gates},
          {"warnings", design.warnings}};
}

std::vector<std::pair<std::string, std::string>> splint_metadata(const SplintDesign& design,
                                                                 const Motion<Dental>& therapeutic,
                                                                 const std::vector<InputRecord>& inputs) {
  std::vector<std::pair<std::string, std::string>> out;
  out.emplace_back("T_th", matrix_json(therapeutic.rigid.matrix()).dump());
  out.emplace_back("arch", arch_name(design.worn_on));
  out.emplace_back("edits", edits_json(design.edits).dump());
  out.emplace_back("parameters", parameters_json(design.parameters).dump());
  for (std::size_t i = 0; i < inputs.size(); ++i)
    out.emplace_back(fmt::format("input_{}", i + 1), inputs[i].path + " sha256:" + inputs[i].sha256);
  return out;
}

}  // namespace gnathion
