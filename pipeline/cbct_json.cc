// What is known of volumes and joints, as JSON.
#include <nlohmann/json.hpp>

#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "pipeline/cbct_steps.h"

namespace gnathion {
namespace {

using nlohmann::json;

json point(const Vector3& p) {
  return {p.x(), p.y(), p.z()};
}
json optional_covariance(const std::optional<Matrix6>& c) {
  return c ? covariance_json(*c) : json();
}

}  // namespace

json joints_json(const Joints& joints) {
  json j = {{"kind", "joints"},
            {"frame", Dental::name},
            {"unit", "mm"},
            {"source", joints.source},
            {"surface_sigma_mm", joints.surface_sigma_mm ? json(*joints.surface_sigma_mm) : json()},
            {"condyle_covariance", optional_covariance(joints.condyle_covariance)},
            {"fossa_covariance", optional_covariance(joints.fossa_covariance)},
            {"mi_assumed", joints.mi_assumed},
            {"warnings", joints.warnings}};
  for (const auto* side : {&joints.left, &joints.right}) {
    if (!*side) continue;
    const Joint& joint = **side;
    j["joints"][side_name(joint.side)] = {{"medial_pole_mm", point(joint.medial_pole_mm)},
                                          {"lateral_pole_mm", point(joint.lateral_pole_mm)},
                                          {"condyle_triangles", joint.condyle.triangles.size()},
                                          {"fossa_triangles", joint.fossa.triangles.size()}};
  }
  return j;
}

Status write_joints(const Joints& joints, const std::filesystem::path& folder) {
  for (const auto* side : {&joints.left, &joints.right}) {
    if (!*side) continue;
    const std::string end = std::string("_") + side_name((*side)->side) + ".stl";
    GNATHION_CHECK_OK(write_mesh(folder / ("condyle" + end), (*side)->condyle));
    GNATHION_CHECK_OK(write_mesh(folder / ("fossa" + end), (*side)->fossa));
  }
  return write_json(folder / "joints.json", joints_json(joints));
}

json volume_info_json(const VolumeInfo& info, bool with_names) {
  const Vector3 spacing = info.grid.spacing_mm();
  json directions = json::array();
  for (int a = 0; a < 3; ++a) {
    const Vector3 d =
        spacing[a] > 0.0 ? Vector3(info.grid.step_mm.col(a) / spacing[a]) : Vector3(Vector3::Zero());
    directions.push_back(point(d));
  }
  json j = {{"format", info.format},
            {"series_uid", info.series_uid},
            {"series_number", info.series_number},
            {"description", info.description},
            {"modality", info.modality},
            {"transfer_syntax", info.transfer_syntax},
            {"date", info.date},
            {"files", info.files},
            {"voxels", info.grid.size},
            {"spacing_mm", point(spacing)},
            {"origin_mm", point(info.grid.origin_mm)},
            {"directions_lps", directions},
            {"gantry_tilt_deg", info.gantry_tilt_deg},
            {"warnings", info.warnings}};
  if (with_names) {
    j["patient_name"] = info.patient_name;
    j["patient_id"] = info.patient_id;
    j["patient_birth_date"] = info.patient_birth_date;
  }
  return j;
}

}  // namespace gnathion
