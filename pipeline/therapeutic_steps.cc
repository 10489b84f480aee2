#include "pipeline/therapeutic_steps.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/mesh_io.h"

namespace gnathion {
namespace {

using nlohmann::json;

json plateau_json(const Plateau& p) {
  return {{"start_s", p.start_s},
          {"end_s", p.end_s},
          {"source", p.source},
          {"frames", p.frames},
          {"frames_used", p.frames_used},
          {"effective_frames", p.effective_frames},
          {"dispersion_mm", p.dispersion_mm},
          {"dispersion_deg", p.dispersion_deg},
          {"sigma_mm", p.sigma_mm},
          {"rank", p.rank}};
}

/// A jaw that moves is in neither position: the mean over it would be a number without meaning.
Status check_rests(const JawPositions& positions, const PlateauOptions& options) {
  constexpr double kLargest_mm = 0.25;  // of the median: single frames may be off, and a mark early
  const auto refuse = [](const Plateau& p, const std::string& why) {
    return bad_input("cannot average MI and TP", fmt::format("{:.2f}..{:.2f} s", p.start_s, p.end_s), why);
  };
  if (positions.mi.size() < options.mi_s.size() || positions.tp.size() < options.tp_s.size())
    return bad_input("cannot average MI and TP", "given intervals",
                     "at least one of them has too few valid frames");
  for (const auto* plateaus : {&positions.mi, &positions.tp})
    for (const Plateau& p : *plateaus)
      if (p.typical_mm > kLargest_mm)
        return refuse(
            p, fmt::format("the jaw does not rest: half of its places are more than {:.2f} mm from the "
                           "mean, {:.2f} allowed",
                           p.typical_mm, kLargest_mm));
  for (const Plateau& mi : positions.mi)
    for (const Plateau& tp : positions.tp)
      if (mi.start_s < tp.end_s && tp.start_s < mi.end_s)
        return refuse(tp, fmt::format("TP overlaps MI, {:.2f}..{:.2f} s", mi.start_s, mi.end_s));
  return {};
}

}  // namespace

Result<ChainScans> read_chain_scans(const ChainFiles& files) {
  ChainScans scans;
  GNATHION_TRY(scans.mandible_mi, read_jaw(files.mandible_mi));
  GNATHION_TRY(scans.bow_model, read_mesh(files.bow_model));
  const auto read_all = [](const std::vector<std::filesystem::path>& paths,
                           std::vector<TriangleMesh>& out) -> Status {
    for (const auto& path : paths) {
      GNATHION_TRY(out.emplace_back(), read_mesh(path));
    }
    return {};
  };
  GNATHION_CHECK_OK(read_all(files.clutch_scans, scans.clutch_scans));
  if (files.faces_mi.empty() != files.faces_tp.empty())
    return fail(ErrorCode::kUsage, "chain of frames",
                (files.faces_mi.empty() ? files.faces_tp : files.faces_mi).front().string(),
                "a face scan in MI and one in TP are needed together");
  GNATHION_CHECK_OK(read_all(files.faces_mi, scans.faces_mi));
  GNATHION_CHECK_OK(read_all(files.faces_tp, scans.faces_tp));
  if (!files.faces_mi.empty() && !files.head_frame_model.empty()) {
    GNATHION_TRY(scans.head_frame_model, read_mesh(files.head_frame_model));
  }
  return scans;
}

Result<JawPositions> resting_positions(const SessionMotion& session, const PlateauOptions& options) {
  GNATHION_TRY(JawPositions positions, find_jaw_positions(session, options));
  GNATHION_CHECK_OK(check_rests(positions, options));
  return positions;
}

Result<CameraRoute> camera_route(const SessionMotion& session, const ChainPose& bow_from_dental,
                                 const PlateauOptions& given) {
  PlateauOptions options = given;
  // Dispersion and closure are told where they matter: at the teeth, the dental origin seen by the bow.
  options.point_in_bow_mm = bow_from_dental.value.translation_mm;
  CameraRoute route;
  GNATHION_TRY(route.positions, resting_positions(session, options));
  for (const Slip& slip : find_slips(session, route.positions, options)) route.slips.push_back(slip.text());
  route.estimate = therapeutic_from_camera(bow_from_dental, route.positions.head_from_bow_mi,
                                           route.positions.head_from_bow_tp);
  return route;
}

json camera_route_source(const CameraRoute& route) {
  json mi = json::array(), tp = json::array(), closures = json::array();
  for (const Plateau& p : route.positions.mi) mi.push_back(plateau_json(p));
  for (const Plateau& p : route.positions.tp) tp.push_back(plateau_json(p));
  for (const Closure& c : route.positions.closures)
    closures.push_back({{"first", c.first},
                        {"second", c.second},
                        {"distance_mm", c.distance_mm},
                        {"sigma_mm", c.sigma_mm},
                        {"angle_deg", c.angle_deg},
                        {"sigmas", c.sigmas}});
  return {{"route", "camera"},
          {"mi", mi},
          {"tp", tp},
          {"closures", closures},
          {"slips", route.slips},
          {"notes", route.positions.notes}};
}

std::string closure_text(const JawPositions& positions) {
  std::string text;
  for (const Closure& c : positions.closures)
    if (!c.consistent())
      text += fmt::format("{}MI {} and {} are {:.3f} mm and {:.3f} deg apart ({:.1f} sigma)",
                          text.empty() ? "" : "; ", c.first + 1, c.second + 1, c.distance_mm, c.angle_deg,
                          c.sigmas);
  return text + ": bow or head frame slipped";
}

std::string closure_text(const CameraRoute& route) {
  if (route.slips.empty()) return closure_text(route.positions);
  std::string text;
  for (const std::string& slip : route.slips) text += (text.empty() ? "" : "; ") + slip;
  return text;
}

std::string motion_text(const Motion<Dental>& motion) {
  const Vector3& t = motion.rigid.translation_mm;
  return fmt::format("T_th: rotation {:.3f} deg, the origin moves by ({:.3f}, {:.3f}, {:.3f}) mm\n",
                     motion.rigid.angle_rad() * 180 / M_PI, t.x(), t.y(), t.z());
}

}  // namespace gnathion
