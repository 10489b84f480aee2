#include "calibration/camera_calibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "calibration/camera_solution.h"

namespace gnathion {
namespace {

using namespace camera_problem;

constexpr const char* kCannotCalibrateCamera = "cannot calibrate camera";

/// Reasons to refuse that need the whole solution.
Status check_determined(const CameraSolution& s) {
  const double f = s.state.intrinsics[0].head<2>().mean();
  if (!s.covariance)
    return bad_input(
        kCannotCalibrateCamera, s.name,
        "the views leave the focal length open: tilt the board, by 20 to 45 degrees, to all sides");
  const double sigma = std::sqrt(std::max((*s.covariance)(0, 0), (*s.covariance)(1, 1)));
  if (!(sigma < 0.03 * f))
    return bad_input(
        kCannotCalibrateCamera, s.name,
        fmt::format("the views leave the focal length open ({:.0f} ± {:.0f} px): tilt the board, by 20 to 45 "
                    "degrees, to all sides",
                    f, sigma));
  const double diagonal = std::hypot(s.width_px, s.height_px);
  if (const double rms = rms_px(s.problem, s.state, -1); rms > 0.01 * diagonal)
    return bad_input(
        kCannotCalibrateCamera, s.name,
        fmt::format("no pinhole camera makes these corners: they are {:.1f} px off (RMS); another board than "
                    "was said, or images that were cropped or scaled each in its own way",
                    rms));
  return {};
}

bool of_two_cameras(const std::optional<Split>& split) {
  return split && split->rms_apart_px < kTwoCamerasRatio * split->rms_together_px &&
         split->separation_sigmas > kTwoCamerasSigmas;
}

Status check_one_camera(const CameraSolution& s, const std::vector<Reduced>& parts) {
  const auto split = best_split(s.problem, s.state, parts);
  if (!of_two_cameras(split)) return {};
  // A bent board, too, asks for other intrinsics from view to view: not if its bend is solved for.
  Problem problem = s.problem;
  State state = s.state;
  problem.free_bend = true;
  const bool solved = solve(problem, Loss::kHuber, 4.5, &state);
  problem.free_bend = false;
  if (solved && !of_two_cameras(best_split(problem, state, reduce(problem, state)))) return {};
  std::string first, second;
  for (const View& v : s.problem.views) {
    std::string& name = split->second[v.instant] ? second : first;
    if (name.empty()) name = s.names[v.instant];
  }
  return bad_input(
      kCannotCalibrateCamera, s.name,
      fmt::format("the views are of two cameras, or the lens was moved between them: '{}' and others ask for "
                  "f = {:.1f} px, '{}' and others for {:.1f} px ({:.3f} px RMS apart, {:.3f} px together)",
                  first, split->focal_px[0], second, split->focal_px[1], split->rms_apart_px,
                  split->rms_together_px));
}

void warn(const CameraSolution& s, const CameraCalibrationOptions& options, CameraCalibration* c) {
  const auto add = [&](std::string text) { c->warnings.push_back(std::move(text)); };
  if (static_cast<int>(c->views.size()) < options.few_views)
    add(fmt::format("only {} views; {} or more make the result firm", c->views.size(), options.few_views));
  double tilt = 0;
  for (const ViewResult& v : c->views) tilt = std::max(tilt, v.tilt_deg);
  if (tilt < 15)
    add(fmt::format("no view is tilted by more than {:.0f} degrees: the focal length rests on little", tilt));
  const double f = s.state.intrinsics[0].head<2>().mean();
  if (c->focal_sigma_px() > 0.005 * f)
    add(fmt::format("focal length known to {:.1f} px only ({:.2f} %)", c->focal_sigma_px(),
                    100 * c->focal_sigma_px() / f));
  if (!c->coverage.thin.empty())
    add(fmt::format("few corners in the image's {}: distortion there is a guess",
                    fmt::join(c->coverage.thin, ", ")));
  if (c->bend.significant && c->bend.sag_mm > 0.02)
    add(fmt::format(
        "the board is bent, or the lens is not of this model: residuals follow a sag of {:.2f} ± {:.2f} mm",
        c->bend.sag_mm, c->bend.sigma_mm));
  if (c->focal_drift_share > 5e-4)
    add(fmt::format("focal length differs from view to view by {:.2f} % beyond noise: is autofocus off?",
                    100 * c->focal_drift_share));
  if (folds_over(c->model))
    add("the distortion folds the image over itself near its corners; try without k3");
  const std::size_t outliers = s.outliers();
  if (outliers > 0) add(fmt::format("{} corners were put aside as outliers", outliers));
}

}  // namespace

double CameraCalibration::focal_sigma_px() const {
  return 0.5 * std::sqrt(std::max(0.0, covariance(0, 0) + 2 * covariance(0, 1) + covariance(1, 1)));
}

namespace camera_problem {

std::size_t CameraSolution::outliers() const {
  std::size_t n = 0;
  for (const View& v : problem.views)
    for (const Corner& c : v.corners) n += !c.used;
  return n;
}

Result<CameraSolution> solve_camera(const CalibrationBoard& board, const std::string& name, int width_px,
                                    int height_px, const std::vector<BoardView>& views,
                                    const CameraCalibrationOptions& options) {
  CameraSolution s;
  s.name = name;
  s.width_px = width_px, s.height_px = height_px;
  std::vector<const BoardView*> kept;
  for (const BoardView& v : views) {
    const auto twin =
        std::find_if(kept.begin(), kept.end(), [&](const BoardView* k) { return same_view(*k, v); });
    if (v.corners.size() < kLeastCorners)
      s.dropped.push_back(fmt::format("{}: {} corners", v.name, v.corners.size()));
    else if (twin != kept.end())
      s.dropped.push_back(fmt::format("{}: the same as {}", v.name, (*twin)->name));
    else
      kept.push_back(&v);
  }
  if (static_cast<int>(kept.size()) < options.min_views)
    return bad_input(kCannotCalibrateCamera, name,
                     fmt::format("{} views of the board, {} distinct; {} are the least, {} are good",
                                 views.size(), kept.size(), options.min_views, 2 * options.few_views));
  s.problem.points = board_points(board);
  s.problem.free_k3 = options.estimate_k3;
  for (const BoardView* v : kept) {
    s.problem.views.push_back(make_view(*v, 0, s.names.size()));
    s.names.push_back(v->name);
  }
  const auto state =
      start_camera(s.problem.points, s.problem.views, width_px, height_px, options.estimate_k3);
  if (!state)
    return bad_input(kCannotCalibrateCamera, name,
                     "the views have no common solution: is it one camera and one flat board?");
  s.state = *state;
  const auto scale = refine(&s.problem, options.loss_sigmas, &s.state);
  if (!scale)
    return bad_input(kCannotCalibrateCamera, name,
                     "the solution does not converge: more views, tilted to all sides, are needed");
  s.noise_scale = *scale;
  const std::vector<Reduced> parts = reduce(s.problem, s.state);
  s.covariance = shared_covariance(parts, *scale);
  GNATHION_CHECK_OK(check_determined(s));
  GNATHION_CHECK_OK(check_one_camera(s, parts));
  s.focal_drift_share = focal_drift(parts, s.state.intrinsics[0], *scale);
  return s;
}

ViewResult result_of(const Problem& problem, const State& state, const View& view, const std::string& name) {
  ViewResult r;
  r.name = name;
  r.corners = view.corners.size();
  r.camera_from_board = state.rig_from_camera[view.camera].inverse() * state.rig_from_board[view.instant];
  double sum = 0;
  Vector3 middle = Vector3::Zero();
  for (const Corner& c : view.corners) {
    const auto e = residual(problem, state, view, c);
    r.corners_px.push_back(c.px);
    r.residuals_px.push_back(e ? *e : Vector2::Constant(std::nan("")));
    sum += e ? e->squaredNorm() : 0;
    middle +=
        problem.points[static_cast<std::size_t>(c.point)].flat_mm / static_cast<double>(view.corners.size());
  }
  r.rms_px = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, view.corners.size())));
  const Vector3 sight = (r.camera_from_board * middle).normalized();
  r.tilt_deg =
      std::acos(std::clamp(std::abs(sight.dot(r.camera_from_board.rotation.col(2))), 0.0, 1.0)) * 180 / M_PI;
  return r;
}

CameraCalibration calibration_of(const CameraSolution& s, const CameraCalibrationOptions& options) {
  CameraCalibration c;
  c.model = model_of(s.state.intrinsics[0], s.width_px, s.height_px);
  c.covariance = *s.covariance;
  c.rms_px = rms_px(s.problem, s.state, -1);
  c.noise_scale = s.noise_scale;
  c.extra_noise_px = s.state.extra_px;
  c.dropped = s.dropped;
  c.focal_drift_share = s.focal_drift_share;
  const std::vector<HeldOut> held = cross_validate(s.problem, s.state, options.folds);
  c.held_out_px = total(held, &HeldOut::own);
  for (std::size_t i = 0; i < s.problem.views.size(); ++i) {
    c.views.push_back(result_of(s.problem, s.state, s.problem.views[i], s.names[i]));
    c.views.back().held_out_px = held[i].own.value_or(0);
  }
  c.coverage = coverage_of(s.problem.views, 0, s.state.intrinsics[0], s.width_px, s.height_px);
  c.bend = bend_of(s.problem, s.state, s.noise_scale);
  warn(s, options, &c);
  return c;
}

}  // namespace camera_problem

Result<CameraCalibration> calibrate_camera(const CalibrationBoard& board, const std::string& name,
                                           int width_px, int height_px, const std::vector<BoardView>& views,
                                           const CameraCalibrationOptions& options, Progress& progress) {
  progress.begin_step("solving", 0.3);
  GNATHION_TRY(const CameraSolution solution, solve_camera(board, name, width_px, height_px, views, options));
  progress.begin_step("cross-validation", 0.1);
  return calibration_of(solution, options);
}

}  // namespace gnathion
