#include "calibration/rig_calibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "calibration/camera_solution.h"

namespace gnathion {
namespace {

using namespace camera_problem;

constexpr const char* kCannotCalibrateRig = "cannot calibrate rig";
constexpr double kAgreeRad = 0.035, kAgreeShare = 0.03;  // of two instants about where a camera stands

/// Where camera b stands in camera a's frame, as one instant has it.
struct Sighting {
  std::string instant;
  Rigid3 a_from_b;
  double distance_mm = 0;  ///< of the board
};

std::vector<Sighting> sightings(const CameraSolution& a, const CameraSolution& b) {
  std::vector<Sighting> out;
  for (std::size_t i = 0; i < a.names.size(); ++i)
    for (std::size_t j = 0; j < b.names.size(); ++j)
      if (a.names[i] == b.names[j])
        out.push_back({a.names[i], a.state.rig_from_board[i] * b.state.rig_from_board[j].inverse(),
                       a.state.rig_from_board[i].translation_mm.norm()});
  return out;
}

bool agree(const Sighting& x, const Sighting& y) {
  const Rigid3 d = x.a_from_b.inverse() * y.a_from_b;
  return d.angle_rad() < kAgreeRad &&
         d.translation_mm.norm() < kAgreeShare * std::min(x.distance_mm, y.distance_mm) +
                                       kAgreeRad * std::min(x.distance_mm, y.distance_mm);
}

/// The sighting that most others agree with.
struct Placed {
  Rigid3 a_from_b;
  std::size_t seen = 0, agreeing = 0;
  std::vector<std::string> others;  ///< instants at odds with it
};
Placed place(const std::vector<Sighting>& all) {
  Placed best;
  best.seen = all.size();
  for (const Sighting& s : all) {
    std::vector<std::string> others;
    for (const Sighting& t : all)
      if (!agree(s, t)) others.push_back(t.instant);
    const std::size_t agreeing = all.size() - others.size();
    if (agreeing > best.agreeing) best = {s.a_from_b, all.size(), agreeing, others};
  }
  return best;
}

/// rig_from_camera of every camera, over the pairs that share most instants first; refuses what is not
/// connected.
Result<std::vector<Rigid3>> place_cameras(const std::vector<CameraSolution>& cameras,
                                          std::set<std::string>* odd) {
  std::vector<std::optional<Rigid3>> placed(cameras.size());
  placed[0] = Rigid3::identity();
  for (std::size_t round = 1; round < cameras.size(); ++round) {
    Placed best;
    std::size_t from = 0, to = 0;
    for (std::size_t a = 0; a < cameras.size(); ++a)
      for (std::size_t b = 0; b < cameras.size(); ++b) {
        if (!placed[a] || placed[b]) continue;
        Placed p = place(sightings(cameras[a], cameras[b]));
        if (p.seen > best.seen) best = std::move(p), from = a, to = b;
      }
    if (best.seen == 0) {
      std::vector<std::string> here, there;
      for (std::size_t c = 0; c < cameras.size(); ++c) (placed[c] ? here : there).push_back(cameras[c].name);
      return bad_input(
          kCannotCalibrateRig, fmt::format("{}", fmt::join(there, ", ")),
          fmt::format("never sees the board together with {} (views of one instant have one name)",
                      fmt::join(here, ", ")));
    }
    if (best.seen < 3 || 2 * best.agreeing <= best.seen)
      return bad_input(
          kCannotCalibrateRig, cameras[to].name,
          fmt::format(
              "{} of {} instants shared with {} agree about where it stands; at least 3 and more than "
              "half are needed: are the pairs of one instant, the cameras fixed to one another, and "
              "neither's images mirrored?",
              best.agreeing, best.seen, cameras[from].name));
    placed[to] = *placed[from] * best.a_from_b;
    odd->insert(best.others.begin(), best.others.end());
  }
  std::vector<Rigid3> out;
  for (const auto& p : placed) out.push_back(*p);
  return out;
}

struct Joint {
  Problem problem;
  State state;
  std::vector<std::string> names;  ///< of the instants
};

Joint join(const std::vector<CameraSolution>& cameras, const std::vector<Rigid3>& rig_from_camera,
           const std::set<std::string>& odd) {
  Joint j;
  j.problem.points = cameras[0].problem.points;
  j.problem.free_k3 = cameras[0].problem.free_k3;
  j.state.rig_from_camera = rig_from_camera;
  std::map<std::string, std::size_t> instants;
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    j.state.intrinsics.push_back(cameras[c].state.intrinsics[0]);
    j.state.extra_px = std::max(j.state.extra_px, cameras[c].state.extra_px);
    for (const View& v : cameras[c].problem.views) {
      const std::string& name = cameras[c].names[v.instant];
      if (odd.count(name)) continue;
      const auto [found, added] = instants.emplace(name, j.names.size());
      if (added) {
        j.names.push_back(name);
        j.state.rig_from_board.push_back(rig_from_camera[c] * cameras[c].state.rig_from_board[v.instant]);
      }
      View copy = v;
      copy.camera = c;
      copy.instant = found->second;
      for (Corner& corner : copy.corners) corner.used = true;
      j.problem.views.push_back(copy);
    }
  }
  return j;
}

/// Cameras one by one, as the joint solution has them; what needs a camera alone (bend, drift) comes from
/// there.
RigCameraResult camera_result(const Joint& j, std::size_t c, const CameraSolution& alone,
                              const Eigen::MatrixXd& covariance, double noise_scale,
                              const std::vector<HeldOut>& held, const CameraCalibrationOptions& options) {
  RigCameraResult r;
  r.name = alone.name;
  r.camera = calibration_of(alone, options);
  const auto at = static_cast<Eigen::Index>(c);
  r.camera.model = model_of(j.state.intrinsics[c], alone.width_px, alone.height_px);
  r.camera.covariance = covariance.block<kIntrinsics, kIntrinsics>(at * kIntrinsics, at * kIntrinsics);
  r.camera.rms_px = rms_px(j.problem, j.state, static_cast<int>(c));
  r.camera.noise_scale = noise_scale;
  r.camera.extra_noise_px = j.state.extra_px;
  r.camera.views.clear();
  std::vector<HeldOut> own;
  for (std::size_t i = 0; i < j.problem.views.size(); ++i) {
    const View& v = j.problem.views[i];
    if (v.camera != c) continue;
    own.push_back(held[i]);
    r.camera.views.push_back(result_of(j.problem, j.state, v, j.names[v.instant]));
    r.camera.views.back().held_out_px = held[i].own.value_or(0);
  }
  r.camera.held_out_px = total(own, &HeldOut::own);
  r.held_out_rig_px = total(own, &HeldOut::rig);
  r.rig_from_camera = j.state.rig_from_camera[c];
  if (c > 0) {
    const auto row = static_cast<Eigen::Index>(kIntrinsics * j.state.cameras()) + 6 * (at - 1);
    r.covariance = covariance.block<6, 6>(row, row);
  }
  return r;
}

}  // namespace

Result<RigCalibration> calibrate_rig(const CalibrationBoard& board,
                                     const std::vector<RigCameraViews>& cameras,
                                     const CameraCalibrationOptions& options, Progress& progress) {
  if (cameras.size() < 2)
    return fail(ErrorCode::kUsage, kCannotCalibrateRig, "cameras", "two or more are needed");
  if (board.turns_unseen())
    return bad_input(kCannotCalibrateRig, board.text(),
                     "looks the same upside down, so that cameras cannot agree on its corners: take a board "
                     "with one odd and "
                     "one even number of corners, ChArUco or AprilGrid");
  std::vector<CameraSolution> alone;
  for (const RigCameraViews& c : cameras) {
    progress.begin_step("solving " + c.name, 0.3 / static_cast<double>(cameras.size()));
    GNATHION_TRY(CameraSolution s, solve_camera(board, c.name, c.width_px, c.height_px, c.views, options));
    alone.push_back(std::move(s));
  }
  progress.begin_step("solving the rig", 0.2);
  std::set<std::string> odd;
  GNATHION_TRY(const std::vector<Rigid3> rig_from_camera, place_cameras(alone, &odd));
  Joint j = join(alone, rig_from_camera, odd);
  const auto scale = refine(&j.problem, options.loss_sigmas, &j.state);
  if (!scale) return bad_input(kCannotCalibrateRig, "joint solution", "does not converge");
  const auto covariance = shared_covariance(reduce(j.problem, j.state), *scale);
  if (!covariance)
    return bad_input(kCannotCalibrateRig, "joint solution",
                     "the views leave the rig open: tilt the board to all sides");
  progress.begin_step("cross-validation", 0.1);
  const std::vector<HeldOut> held = cross_validate(j.problem, j.state, options.folds);
  RigCalibration out;
  out.noise_scale = *scale;
  out.rms_px = rms_px(j.problem, j.state, -1);
  out.held_out_px = total(held, &HeldOut::rig);
  out.covariance = *covariance;
  std::map<std::size_t, int> together;
  for (const View& v : j.problem.views) ++together[v.instant];
  for (const auto& [instant, count] : together) out.shared_instants += count > 1;
  for (std::size_t c = 0; c < alone.size(); ++c) {
    out.cameras.push_back(camera_result(j, c, alone[c], *covariance, *scale, held, options));
    for (const std::string& w : out.cameras.back().camera.warnings)
      out.warnings.push_back(alone[c].name + ": " + w);
  }
  if (out.shared_instants < 8)
    out.warnings.push_back(fmt::format(
        "only {} instants are seen by two cameras; 8 or more make the rig firm", out.shared_instants));
  if (!odd.empty())
    out.warnings.push_back(fmt::format("{} instants were left out, at odds about where the cameras stand: {}",
                                       odd.size(), fmt::join(odd, ", ")));
  return out;
}

}  // namespace gnathion
