#include "calibration/camera_refine.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace gnathion::camera_problem {
namespace {

constexpr double kOutlierSigmas = 4.5;
constexpr double kMedianOfChi2 = 1.3862943611198906;  // of two degrees of freedom: 2 ln 2

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Residual {
  const Corner* corner;
  Vector2 px;
};

std::vector<Residual> residuals_of(const Problem& problem, const State& state) {
  std::vector<Residual> out;
  for (const View& v : problem.views)
    for (const Corner& c : v.corners)
      if (const auto r = residual(problem, state, v, c); r && c.used) out.push_back({&c, *r});
  return out;
}

std::size_t parameters(const Problem& problem, const State& state) {
  std::vector<char> there(state.rig_from_board.size(), 0);
  for (const View& v : problem.views) there[v.instant] = 1;
  const auto poses = static_cast<std::size_t>(std::count(there.begin(), there.end(), 1));
  return problem.shared_count(state) + 6 * poses - (problem.free_k3 ? 0 : state.cameras());
}

/// The noise with which the median of the squared residuals is what it should be. The parameters have taken
/// up their share of it.
double extra_noise(const std::vector<Residual>& residuals, double freedom) {
  const auto ratio = [&](double extra) {
    std::vector<double> squared;
    for (const Residual& r : residuals) squared.push_back(squared_sigmas(*r.corner, r.px, extra));
    return median(std::move(squared)) / (kMedianOfChi2 * freedom);
  };
  if (ratio(0) <= 1) return 0;
  double low = 0, high = 1;
  while (ratio(high) > 1 && high < 1e3) high *= 2;
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (low + high);
    (ratio(middle) > 1 ? low : high) = middle;
  }
  return high;
}

}  // namespace

std::optional<double> refine(Problem* problem, double loss_sigmas, State* state) {
  state->extra_px = std::max(state->extra_px, 0.3);
  double freedom = 1;
  for (int round = 0; round < 3; ++round) {
    if (!solve(*problem, Loss::kCauchy, loss_sigmas, state)) return std::nullopt;
    const std::vector<Residual> all = residuals_of(*problem, *state);
    const double count = 2 * static_cast<double>(all.size());
    const double unknowns = static_cast<double>(parameters(*problem, *state));
    if (count <= unknowns + 2) return std::nullopt;
    freedom = 1 - unknowns / count;
    state->extra_px = extra_noise(all, freedom);
  }
  const double limit = kOutlierSigmas * kOutlierSigmas;
  for (View& v : problem->views)
    for (Corner& c : v.corners) {
      const auto r = residual(*problem, *state, v, c);
      c.used = r && squared_sigmas(c, *r, state->extra_px) < limit;
    }
  if (!solve(*problem, Loss::kHuber, kOutlierSigmas, state)) return std::nullopt;
  const std::vector<Residual> used = residuals_of(*problem, *state);
  double chi2 = 0;
  for (const Residual& r : used) chi2 += squared_sigmas(*r.corner, r.px, state->extra_px);
  const double dof = 2 * static_cast<double>(used.size()) - static_cast<double>(parameters(*problem, *state));
  if (dof < 2) return std::nullopt;
  return std::sqrt(chi2 / dof);
}

std::vector<HeldOut> cross_validate(const Problem& problem, const State& state, int folds) {
  const std::size_t instants = state.rig_from_board.size();
  const std::size_t count = std::min<std::size_t>(instants, static_cast<std::size_t>(std::max(folds, 2)));
  std::vector<HeldOut> out(problem.views.size());
  const auto fold_of = [&](const View& v) { return v.instant * count / instants; };
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t fold) {
    Problem rest = problem;
    std::erase_if(rest.views, [&](const View& v) { return fold_of(v) == fold; });
    State without = state;
    if (!solve(rest, Loss::kHuber, kOutlierSigmas, &without)) return;
    for (std::size_t i = 0; i < problem.views.size(); ++i) {
      const View& v = problem.views[i];
      if (fold_of(v) != fold) continue;
      double sum = 0;
      std::size_t seen = 0;
      const auto add = [&](const Rigid3& pose, const auto& select) {
        without.rig_from_board[v.instant] = pose;
        for (const Corner& c : v.corners)
          if (const auto r = residual(problem, without, v, c); r && select(c.point))
            sum += r->squaredNorm(), ++seen;
      };
      for (const int half : {0, 1}) {
        Rigid3 pose = state.rig_from_board[v.instant];
        if (fit_pose(
                problem, without, v, [&](int p) { return p % 2 == half; }, &pose))
          add(pose, [&](int p) { return p % 2 != half; });
      }
      if (seen > 0) out[i] = {std::sqrt(sum / static_cast<double>(seen)), std::nullopt, seen};
      const auto first = std::find_if(problem.views.begin(), problem.views.end(),
                                      [&](const View& w) { return w.instant == v.instant; });
      if (first->camera == v.camera) continue;
      Rigid3 pose = state.rig_from_board[v.instant];
      const auto every = [](int) { return true; };
      if (!fit_pose(problem, without, *first, every, &pose)) continue;
      sum = 0, seen = 0;
      add(pose, every);
      if (seen > 0) out[i].rig = std::sqrt(sum / static_cast<double>(seen));
    }
  });
  return out;
}

double total(const std::vector<HeldOut>& views, std::optional<double> HeldOut::*which) {
  double sum = 0, count = 0;
  for (const HeldOut& h : views)
    if (const auto& value = h.*which) {
      sum += *value * *value * static_cast<double>(h.corners);
      count += static_cast<double>(h.corners);
    }
  return count > 0 ? std::sqrt(sum / count) : 0;
}

double rms_px(const Problem& problem, const State& state, int camera) {
  double sum = 0, count = 0;
  for (const View& v : problem.views) {
    if (camera >= 0 && v.camera != static_cast<std::size_t>(camera)) continue;
    for (const Corner& c : v.corners)
      if (const auto r = residual(problem, state, v, c)) sum += r->squaredNorm(), ++count;
  }
  return count > 0 ? std::sqrt(sum / count) : 0;
}

}  // namespace gnathion::camera_problem
