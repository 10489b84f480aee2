#include "calibration/bow_geometry_json.h"

#include <nlohmann/json.hpp>

namespace gnathion {
namespace {

using nlohmann::json;

json vector_json(const Vector3& v) {
  return {v.x(), v.y(), v.z()};
}

json tag_json(const TagGeometry& t) {
  json corners = json::array(), covariance = json::array();
  for (const Vector3& c : t.tag.corners_in_body_mm) corners.push_back(vector_json(c));
  for (int r = 0; r < 12; ++r) {
    json row = json::array();
    for (int c = 0; c < 12; ++c) row.push_back(t.covariance_mm2(r, c));
    covariance.push_back(row);
  }
  return {{"id", t.tag.id},
          {"corners_mm", corners},
          {"covariance_mm2", covariance},
          {"sigma_mm", t.sigma_mm},
          {"width_mm", t.width_mm},
          {"height_mm", t.height_mm},
          {"shift_from_cad_mm", vector_json(t.shift_mm)},
          {"distance_from_cad_mm", t.shift_mm.norm()},
          {"turn_from_cad_deg", t.turn_deg},
          {"rms_px", t.rms_px},
          {"views", t.views},
          {"rejected", t.rejected}};
}

}  // namespace

json bow_geometry_json(const BowGeometry& g) {
  json tags = json::array(), views = json::array(), left_out = json::array(), witnesses = json::array();
  for (const TagGeometry& t : g.tags) tags.push_back(tag_json(t));
  for (const ViewResidual& v : g.views)
    views.push_back({{"name", v.name}, {"rms_px", v.rms_px}, {"tags", v.tags}});
  for (const LeftOutTag& t : g.left_out) left_out.push_back({{"id", t.id}, {"reason", t.reason}});
  for (const ScaleWitness& w : g.scale_witnesses)
    witnesses.push_back({{"name", w.name}, {"factor", w.factor}, {"sigma", w.sigma}});
  return {{"body", g.body.name},
          {"family", g.body.family},
          {"gauge", "best rigid fit of the corners to the CAD layout"},
          {"tags", tags},
          {"left_out", left_out},
          {"views", views},
          {"rms_px", g.rms_px},
          {"residual_scale", g.residual_scale},
          {"held_out_px", g.held_out_px},
          {"held_out_tags", g.held_out_tags},
          {"turn_deg", g.turn_deg},
          {"scale",
           {{"factor", g.scale},
            {"sigma", g.scale_sigma},
            {"mm_on_100_mm", 100 * g.scale_sigma},
            {"witnesses", witnesses}}},
          {"shape_sigma_mm", g.shape_sigma_mm},
          {"shift_for_focal_length_0_1_percent_mm", g.focal_sensitivity_mm},
          {"datum_sigma_mm", g.datum_sigma_mm},
          {"datum_sigma_deg", g.datum_sigma_deg},
          {"condition", g.condition},
          {"weak", g.weak},
          {"warnings", g.warnings}};
}

}  // namespace gnathion
