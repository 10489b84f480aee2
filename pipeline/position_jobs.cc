#include "pipeline/position_jobs.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "occlusion/teeth.h"
#include "pipeline/version.h"

namespace gnathion {
namespace {

using nlohmann::json;

json point_json(const Vector3& p) {
  return {p.x(), p.y(), p.z()};
}

Result<std::vector<MandiblePose>> read_recordings(const std::vector<std::filesystem::path>& files) {
  std::vector<MandiblePose> recordings;
  for (const auto& file : files) {
    GNATHION_TRY(const MotionFile motion, read_motion(file));
    if (!motion.covariance)
      return bad_input("cannot compare", file.string(), "has no covariance: its error is not known");
    recordings.push_back({motion.motion, *motion.covariance});
  }
  return recordings;
}

Result<Landmark> parse_landmark(const std::string& text) {
  Landmark l;
  const std::size_t equals = text.find('=');
  char rest = 0;
  l.name = text.substr(0, equals);
  if (equals == std::string::npos || l.name.empty() ||
      std::sscanf(text.c_str() + equals + 1, "%lf,%lf,%lf%c", &l.at_mm.x(), &l.at_mm.y(), &l.at_mm.z(),
                  &rest) != 3 ||
      !l.at_mm.allFinite())
    return fail(ErrorCode::kUsage, "cannot compare", text, "a landmark is NAME=X,Y,Z in millimetres");
  return l;
}

/// Incisors and first molars of the mandible, as far as they are there.
std::vector<Landmark> landmarks_on_teeth(const TriangleMesh& mandible, const ArchFrame& arch) {
  const std::vector<std::uint8_t> fdi = assign_teeth(mandible, arch, Arch::kMandible);
  const auto middle_of = [&](std::initializer_list<int> teeth, const char* name, std::vector<Landmark>& out) {
    Vector3 sum = Vector3::Zero();
    std::size_t n = 0;
    for (std::size_t v = 0; v < fdi.size(); ++v)
      for (int tooth : teeth)
        if (fdi[v] == tooth) sum += mandible.vertices_mm[v], ++n;
    if (n > 0) out.push_back({name, sum / static_cast<double>(n)});
  };
  std::vector<Landmark> landmarks;
  middle_of({31, 41}, "incisors", landmarks);
  middle_of({36}, "molar_left", landmarks);
  middle_of({46}, "molar_right", landmarks);
  return landmarks;
}

Result<Uncertain<Rigid3>> pose_from(const json& position, const char* key, const std::string& where) {
  const std::string at = fmt::format("{}: {}", where, key);
  if (!position.is_object() || !position.contains(key) || !position[key].is_object() ||
      !position[key].contains("matrix"))
    return bad_input("cannot read positions", at, "no pose with a matrix");
  GNATHION_TRY(const Matrix4 matrix, matrix_from_json(position[key]["matrix"], at));
  const RigidityDeviation deviation = rigidity_deviation(matrix);
  if (!deviation.is_rigid())
    return bad_input("cannot read positions", at,
                     fmt::format("not rigid: determinant {:.6f}", deviation.determinant));
  Uncertain<Rigid3> pose{nearest_rigid(matrix), Matrix6::Zero()};
  if (position[key].contains("covariance") && !position[key]["covariance"].is_null()) {
    GNATHION_TRY(pose.covariance, covariance_from_json(position[key]["covariance"], at));
  }
  return pose;
}

json pose_json(const Uncertain<Rigid3>& pose) {
  return {{"matrix", matrix_json(pose.value.matrix())}, {"covariance", covariance_json(pose.covariance)}};
}

json repeated_json(const RepeatedPose& r) {
  return {{"recordings", r.recordings},
          {"scatter_deg", r.scatter_deg},
          {"scatter_mm", r.scatter_mm},
          {"mean",
           {{"matrix", matrix_json(r.mean.value.rigid.matrix())},
            {"covariance", covariance_json(r.mean.covariance)}}}};
}

}  // namespace

Result<Discrepancy> run_discrepancy(const DiscrepancyJob& job) {
  std::vector<Landmark> further;
  for (const std::string& text : job.landmarks) {
    GNATHION_TRY(Landmark l, parse_landmark(text));
    further.push_back(std::move(l));
  }
  GNATHION_TRY(const std::vector<MandiblePose> mi, read_recordings(job.mi));
  GNATHION_TRY(const std::vector<MandiblePose> cr, read_recordings(job.cr));
  GNATHION_TRY(const TriangleMesh maxilla, read_jaw(job.maxilla));
  GNATHION_TRY(const TriangleMesh mandible, read_jaw(job.mandible));
  GNATHION_TRY(const ArchFrame arch, find_arch(maxilla, mandible));
  std::vector<Landmark> landmarks = landmarks_on_teeth(mandible, arch);
  landmarks.insert(landmarks.end(), further.begin(), further.end());
  return find_discrepancy(mi, cr, landmarks, arch);
}

json discrepancy_json(const Discrepancy& d) {
  json j = {{"kind", "motion"},
            {"frame", "dental"},
            {"unit", "mm"},
            {"matrix", matrix_json(d.cr_from_mi.value.rigid.matrix())},
            {"covariance", covariance_json(d.cr_from_mi.covariance)},
            {"source", {{"route", "discrepancy"}, {"version", kVersion}}},
            {"alpha_deg", d.alpha_deg},
            {"alpha95_deg", d.alpha95_deg},
            {"chi2", d.chi2},
            {"p_value", d.p_value},
            {"mi", repeated_json(d.mi)},
            {"cr", repeated_json(d.cr)}};
  j["landmarks"] = json::array();
  for (const LandmarkShift& s : d.landmarks)
    j["landmarks"].push_back({{"name", s.landmark.name},
                              {"at_mm", point_json(s.landmark.at_mm)},
                              {"displacement_mm", point_json(s.displacement_mm)},
                              {"left_front_up_mm", point_json(s.in_arch_mm)},
                              {"left_front_up95_mm", point_json(s.in_arch95_mm)},
                              {"length_mm", s.length_mm},
                              {"bound95_mm", s.bound95_mm}});
  return j;
}

std::string discrepancy_text(const Discrepancy& d) {
  std::string text = fmt::format(
      "CR from MI: {:.2f} ± {:.2f} deg; {} (p {:.3g})\n", d.alpha_deg, d.alpha95_deg,
      d.p_value < 0.05 ? "more than the recordings' error" : "within the recordings' error", d.p_value);
  for (const LandmarkShift& s : d.landmarks)
    text += fmt::format(
        "  {:<16}{:7.2f} mm, 95 % within {:.2f}   left {:+.2f} ± {:.2f}, front {:+.2f} ± {:.2f}, up {:+.2f} "
        "± {:.2f}\n",
        s.landmark.name, s.length_mm, s.bound95_mm, s.in_arch_mm.x(), s.in_arch95_mm.x(), s.in_arch_mm.y(),
        s.in_arch95_mm.y(), s.in_arch_mm.z(), s.in_arch95_mm.z());
  return text;
}

Result<InstrumentLink> run_registration_object(const std::filesystem::path& path) {
  GNATHION_TRY(const json file, read_json(path));
  if (!file.is_object() || !file.contains("positions") || !file["positions"].is_array())
    return bad_input("cannot read positions", path.string(), "no list 'positions'");
  const json common = file.value("common_object_frame", json(true));
  if (!common.is_boolean())
    return bad_input("cannot read positions", path.string(), "common_object_frame is not true or false");
  std::vector<ObjectPosition> positions;
  for (const json& p : file["positions"]) {
    ObjectPosition position;
    position.name = p.is_object() && p.contains("name") && p["name"].is_string()
                        ? p["name"].get<std::string>()
                        : std::to_string(positions.size() + 1);
    const std::string where = fmt::format("{}: position {}", path.string(), position.name);
    GNATHION_TRY(position.a_from_object, pose_from(p, "a_from_object", where));
    GNATHION_TRY(position.b_from_object, pose_from(p, "b_from_object", where));
    positions.push_back(std::move(position));
  }
  return link_instruments(positions, {common.get<bool>()});
}

json instrument_link_json(const InstrumentLink& link) {
  return {{"a_from_b", pose_json(link.a_from_b)},
          {"common_object_frame", link.common_object_frame},
          {"object_a_from_object_b", pose_json(link.object_a_from_object_b)},
          {"condition", link.condition},
          {"weak", link.weak},
          {"rms_mm", link.rms_mm},
          {"rms_deg", link.rms_deg},
          {"chi2", link.chi2},
          {"degrees_of_freedom", link.degrees_of_freedom},
          {"p_value", link.p_value},
          {"motion_in_a", matrix_json(link.motion_in_a.matrix())},
          {"motion_in_a_by_b", matrix_json(link.motion_in_a_by_b.matrix())},
          {"version", kVersion}};
}

std::string instrument_link_text(const InstrumentLink& link) {
  std::string text = fmt::format("closes to {:.3f} mm and {:.3f} deg; condition {:.3g}; p {:.3g}\n",
                                 link.rms_mm, link.rms_deg, link.condition, link.p_value);
  for (const std::string& w : link.weak) text += "  weak: " + w + "\n";
  return text;
}

}  // namespace gnathion
