// feasibility.json.
#include <nlohmann/json.hpp>

#include "anatomy/realizability.h"

namespace gnathion {
namespace {

using nlohmann::json;

json point_json(const Vector3& p) {
  return {p.x(), p.y(), p.z()};
}
json known(const std::optional<double>& value) {
  return value ? json(*value) : json(nullptr);
}

json constraint_json(const Constraint& c) {
  json teeth = json::array();
  for (const auto fdi : c.teeth) teeth.push_back(static_cast<int>(fdi));
  return {{"name", c.name},
          {"value", c.checked ? json(c.value) : json(nullptr)},
          {"limit", c.checked ? json(c.limit) : json(nullptr)},
          {"unit", c.unit},
          {"pass", c.pass},
          {"checked", c.checked},
          {"where_mm", point_json(c.where_mm)},
          {"teeth", teeth},
          {"consequence", c.consequence},
          {"effect", severity_name(c.severity)},
          {"sigma", known(c.sigma)},
          {"confidence", known(c.confidence())}};
}

json tooth_json(const ToothRoom& t) {
  return {{"fdi", static_cast<int>(t.fdi)},
          {"opposing_fdi", static_cast<int>(t.opposing_fdi)},
          {"room", t.room},
          {"clearance_mm", t.clearance_mm},
          {"vertical_mm", t.opposed ? json(t.vertical_mm) : json(nullptr)},
          {"overlap_beyond_mi_mm", t.overlap_beyond_mi_mm},
          {"overlap_mm3", t.overlap_mm3}};
}

json gap_json(const StampGap& g) {
  return {{"area_mm2", g.area_mm2}, {"p05_mm", g.p05_mm},           {"median_mm", g.median_mm},
          {"p95_mm", g.p95_mm},     {"contact_mm2", g.contact_mm2}, {"kept_contact_mm2", g.kept_contact_mm2}};
}

json support_json(const SupportReport& s) {
  json polygon = json::array();
  for (const Vector3& p : s.polygon_mm) polygon.push_back(point_json(p));
  return {{"stamp_gap",
           {{"left", gap_json(s.left)},
            {"front", gap_json(s.front)},
            {"right", gap_json(s.right)},
            {"all", gap_json(s.all)}}},
          {"polygon_mm", polygon},
          {"polygon_mm2", s.polygon_mm2},
          {"margin_mm", polygon.empty() ? json(nullptr) : json(s.margin_mm)}};
}

json space_json(const JointSpace& s) {
  return {
      {"min_mm", s.min_mm}, {"condyle_mm", point_json(s.condyle_mm)}, {"fossa_mm", point_json(s.fossa_mm)}};
}

json joints_json(const Feasibility& f) {
  json joints = {{"source", f.joints_source}};
  for (const JointReport& r : f.joints)
    joints[side_name(r.side)] = {{"mi", space_json(r.mi)},
                                 {"tp", space_json(r.tp)},
                                 {"sigma_mm", known(r.sigma_mm)},
                                 {"condyle_left_back_up_mm", point_json(r.condyle_path_mm)}};
  return joints;
}

}  // namespace

json feasibility_json(const Feasibility& f) {
  json j = {{"verdict", verdict_name(f.verdict)}, {"violated", f.violated()}};
  j["constraints"] = json::array();
  for (const auto& c : f.constraints) j["constraints"].push_back(constraint_json(c));
  j["teeth"] = json::array();
  for (const auto& t : f.teeth) j["teeth"].push_back(tooth_json(t));
  j["overlap"] = {{"depth_mm", f.overlap.depth_mm},
                  {"volume_mm3", f.overlap.volume_mm3},
                  {"mi_depth_mm", f.overlap.mi_depth_mm},
                  {"mi_volume_mm3", f.overlap.mi_volume_mm3},
                  {"beyond_mi_mm3", f.overlap.beyond_mi_mm3()}};
  j["support"] = support_json(f.support);
  j["joints"] = joints_json(f);
  j["notes"] = f.notes;
  return j;
}

}  // namespace gnathion
