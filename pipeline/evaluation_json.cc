#include "pipeline/evaluation_json.h"

#include <nlohmann/json.hpp>

#include "core/transform_io.h"
#include "pipeline/version.h"

namespace gnathion {
namespace {

using nlohmann::json;

json number_or_null(const std::optional<double>& value) {
  return value ? json(*value) : json(nullptr);
}

json point_json(const Vector3& p) {
  return {p.x(), p.y(), p.z()};
}

json totals_json(const Totals& t) {
  return {{"n_total", t.n_total},
          {"weighted_mean_mm", t.weighted_mean_mm},
          {"total_std_mm", t.total_std_mm},
          {"within_std_mm", t.within_std_mm}};
}

json interval_json(const Interval& i) {
  return {i.low, i.high};
}

json table_details(const ProcedureTable& t) {
  json j = {{"procedure", t.procedure},
            {"splints", t.totals.splints},
            {"totals", totals_json(t.totals)},
            {"mean_alpha_deg", number_or_null(t.totals.mean_alpha_deg)},
            {"mean_t_mm", number_or_null(t.totals.mean_t_mm)},
            {"splints_without_outliers", t.without_outliers.splints},
            {"without_outliers", totals_json(t.without_outliers)}};
  for (const SplintRow& r : t.splints) j["robust_z"][r.splint] = r.robust_z;
  j["bootstrap"] = nullptr;
  if (t.bootstrap)
    j["bootstrap"] = {{"resamples", t.bootstrap->resamples},
                      {"weighted_mean95_mm", interval_json(t.bootstrap->weighted_mean95_mm)},
                      {"weighted_mean90_mm", interval_json(t.bootstrap->weighted_mean90_mm)},
                      {"total_std95_mm", interval_json(t.bootstrap->total_std95_mm)}};
  j["equivalence"] = nullptr;
  if (t.equivalence)
    j["equivalence"] = {{"tolerance_mm", t.equivalence->tolerance_mm},
                        {"mean_mm", t.equivalence->mean_mm},
                        {"standard_error_mm", t.equivalence->standard_error_mm},
                        {"p_lower", t.equivalence->p_lower},
                        {"p_upper", t.equivalence->p_upper},
                        {"by_t", t.equivalence->by_t},
                        {"by_bootstrap", t.equivalence->by_bootstrap},
                        {"equivalent", t.equivalence->equivalent()}};
  return j;
}

json tables_details(const std::vector<ProcedureTable>& tables) {
  json list = json::array();
  for (const ProcedureTable& t : tables) list.push_back(table_details(t));
  return list;
}

json points_json(const PointStatistics& p) {
  return {{"n", p.n}, {"avg_mm", p.avg_mm}, {"std_mm", p.std_mm}};
}

json fit_json(const FitReport& f) {
  return {{"region", f.region},
          {"points", f.points},
          {"rms_mm", f.rms_mm},
          {"held_out_mm", f.held_out_mm},
          {"condition", f.condition},
          {"inlier_fraction", f.inlier_fraction},
          {"weak", f.weak},
          {"scale", f.scale},
          {"covariance", covariance_json(f.covariance)}};
}

json motion_figure_json(const MotionFigure& m) {
  return {{"matrix", matrix_json(m.motion.rigid.matrix())},
          {"covariance", covariance_json(m.covariance)},
          {"centroid_mm", point_json(m.centroid_mm)},
          {"alpha_deg", m.alpha_deg},
          {"alpha_sigma_deg", m.alpha_sigma_deg},
          {"t_mm", m.t_mm},
          {"t_sigma_mm", m.t_sigma_mm},
          {"max_tooth_mm", m.max_tooth_mm},
          {"max_tooth_fdi", m.max_tooth_fdi}};
}

json procedure_json(const ProcedureResult& r) {
  json j = {
      {"procedure", procedure_name(r.procedure)},
      {"fitted_region", r.fitted_region},
      {"measured_region", r.measured_region},
      {"all_points", points_json(r.field.all)},
      {"without_peripheral", points_json(r.field.core)},
      {"peripheral",
       {{"near_boundary", r.field.boundary}, {"steep", r.field.steep}, {"beyond_rim", r.field.beyond_rim}}},
      {"not_measured", {{"beyond_reach", r.field.far}, {"of_another_body", r.field.foreign}}},
      {"dental_from_scan", matrix_json(r.field.dental_from_scan.matrix())}};
  j["fit"] = r.fit ? fit_json(*r.fit) : json(nullptr);
  j["motion"] = r.motion ? motion_figure_json(*r.motion) : json(nullptr);
  return j;
}

json spread_json(const Spread& s) {
  if (s.n == 0) return nullptr;
  return {{"n", s.n}, {"min_mm", s.min_mm}, {"median_mm", s.median_mm}, {"max_mm", s.max_mm}};
}

json collision_json(const CollisionFigures& c) {
  return {{"points", c.points},
          {"depth_mm", c.depth_mm},
          {"area_mm2", c.area_mm2},
          {"where_mm", point_json(c.where_mm)}};
}

template <class T, class F>
json optional_json(const std::optional<T>& value, F&& to_json) {
  return value ? json(to_json(*value)) : json(nullptr);
}

json profile_json(const ProfileFigures& f) {
  json j = {{"name", f.plane.name},
            {"point_mm", point_json(f.plane.point_mm)},
            {"normal", point_json(f.plane.normal)},
            {"planned", {{"gap", spread_json(f.planned_gap)}, {"wall", spread_json(f.planned_wall)}}},
            {"printed", {{"gap", spread_json(f.printed_gap)}, {"wall", spread_json(f.printed_wall)}}}};
  json columns = json::object();
  for (const ProfilePoint& p : f.points) {
    columns["along_mm"].push_back(p.along_mm);
    columns["planned_gap_mm"].push_back(p.planned_gap_mm);
    columns["planned_wall_mm"].push_back(p.planned_wall_mm);
    columns["printed_gap_mm"].push_back(number_or_null(p.printed_gap_mm));
    columns["printed_wall_mm"].push_back(number_or_null(p.printed_wall_mm));
  }
  j["points"] = columns;
  return j;
}

json integrity_json(const Integrity& i) {
  json j = {
      {"collision_limit_mm", i.collision_limit_mm},
      {"planned",
       {{"maxilla", collision_json(i.planned_maxilla)},
        {"mandible", collision_json(i.planned_mandible)},
        {"self_intersections", i.planned_self_intersections},
        {"seat_gap", spread_json(i.planned_seat_gap)}}},
      {"printed",
       {{"maxilla", optional_json(i.printed_maxilla, collision_json)},
        {"mandible", optional_json(i.printed_mandible, collision_json)},
        {"self_intersections", optional_json(i.printed_self_intersections, [](std::size_t n) { return n; })},
        {"seat_gap", optional_json(i.printed_seat_gap, spread_json)}}}};
  j["profiles"] = json::array();
  for (const ProfileFigures& f : i.profiles) j["profiles"].push_back(profile_json(f));
  return j;
}

json splint_json(const SplintEvaluation& s, bool integrity) {
  json j = {{"splint", s.name},
            {"design", s.planned.name},
            {"dental_from_seated", matrix_json(s.dental_from_seated.matrix())},
            {"warnings", s.warnings}};
  j["procedures"] = json::array();
  for (const ProcedureResult& r : s.procedures) j["procedures"].push_back(procedure_json(r));
  j["integrity"] = integrity ? integrity_json(s.integrity) : json(nullptr);
  return j;
}

const char* region_name(SeatRegion region) {
  constexpr const char* kNames[] = {"auto", "palate", "crowns", "whole"};
  return kNames[static_cast<int>(region)];
}

}  // namespace

json evaluation_json(const std::vector<ProcedureTable>& tables, const std::vector<std::string>& notes) {
  json procedures = json::array();
  for (const ProcedureTable& t : tables) {
    json j = totals_json(t.totals);
    j["procedure"] = t.procedure;
    j["without_outliers"] = totals_json(t.without_outliers);
    j["splints"] = json::array();
    for (const SplintRow& r : t.splints)
      j["splints"].push_back({{"splint", r.splint},
                              {"n", r.n},
                              {"avg_mm", r.avg_mm},
                              {"std_mm", r.std_mm},
                              {"alpha_deg", number_or_null(r.alpha_deg)},
                              {"t_mm", number_or_null(r.t_mm)},
                              {"max_tooth_mm", number_or_null(r.max_tooth_mm)},
                              {"outlier", r.outlier}});
    procedures.push_back(std::move(j));
  }
  return {{"procedures", procedures}, {"notes", notes}};
}

json evaluation_details_json(const EvaluationOutcome& o) {
  const EvaluationOptions& e = o.job.options;
  const StatisticsOptions& s = o.job.statistics;
  const EvaluationTolerance& t = o.job.tolerance;
  json j = {{"version", kVersion},
            {"verdict", o.accepted() ? "pass" : "fail"},
            {"violated", o.violated},
            {"notes", o.notes},
            {"parameters",
             {{"seat_region", region_name(e.seat_region)},
              {"reach_mm", e.reach_mm},
              {"rim_mm", e.rim_mm},
              {"steep_deg", e.steep_deg},
              {"noise_mm", e.noise_mm},
              {"points", e.points},
              {"seed", e.seed},
              {"outlier_z", s.outlier_z},
              {"resamples", s.resamples},
              {"tolerance",
               {{"avg_mm", number_or_null(t.avg_mm)},
                {"std_mm", number_or_null(t.std_mm)},
                {"alpha_deg", number_or_null(t.alpha_deg)},
                {"t_mm", number_or_null(t.t_mm)},
                {"max_tooth_mm", number_or_null(t.max_tooth_mm)},
                {"equivalence_mm", number_or_null(t.equivalence_mm)}}}}}};
  j["inputs"] = json::array();
  for (const EvaluationInput& i : o.inputs) j["inputs"].push_back({{"path", i.path}, {"sha256", i.sha256}});
  j["statistics"] = {{"all_points", tables_details(o.tables)},
                     {"without_peripheral", tables_details(o.core_tables)}};
  j["splints"] = json::array();
  for (const SplintEvaluation& splint : o.splints) j["splints"].push_back(splint_json(splint, e.integrity));
  return j;
}

}  // namespace gnathion
