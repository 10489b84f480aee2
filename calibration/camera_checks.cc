#include "calibration/camera_checks.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

namespace gnathion::camera_problem {
namespace {

constexpr double kSamePx = 2.0;
constexpr std::size_t kLeastInPart = 3;  // views of each camera that a split needs

/// What a step of the intrinsics saves in each part: ½ Gᵀ H⁻¹ G, summed; −1 where a part is too small.
double saving(const std::vector<Reduced>& views, const std::vector<bool>& second, Eigen::VectorXd steps[2]) {
  double sum = 0;
  for (const bool part : {false, true}) {
    Eigen::MatrixXd h = Eigen::MatrixXd::Zero(kIntrinsics, kIntrinsics);
    Eigen::VectorXd g = Eigen::VectorXd::Zero(kIntrinsics);
    std::size_t count = 0;
    for (std::size_t i = 0; i < views.size(); ++i) {
      if (second[i] != part) continue;
      h += views[i].information;
      g += views[i].gradient;
      ++count;
    }
    if (count < kLeastInPart) return -1;
    for (Eigen::Index i = 0; i < kIntrinsics; ++i) h(i, i) = h(i, i) * (1 + 1e-9) + 1e-12;
    steps[part] = h.ldlt().solve(g);
    if (!steps[part].allFinite()) return -1;
    sum += 0.5 * g.dot(steps[part]);
  }
  return sum;
}

}  // namespace

bool same_view(const BoardView& a, const BoardView& b) {
  std::map<int, Vector2> in_a;
  for (const BoardCorner& c : a.corners) in_a[c.id] = c.px;
  double sum = 0;
  std::size_t shared = 0;
  for (const BoardCorner& c : b.corners)
    if (const auto found = in_a.find(c.id); found != in_a.end()) {
      sum += (found->second - c.px).squaredNorm();
      ++shared;
    }
  return 10 * shared >= 9 * std::max(a.corners.size(), b.corners.size()) &&
         sum < kSamePx * kSamePx * static_cast<double>(shared);
}

CoverageMap coverage_of(const std::vector<View>& views, std::size_t camera, const Vector9& k, int width_px,
                        int height_px) {
  CoverageMap map;
  map.counts.assign(static_cast<std::size_t>(map.columns * map.rows), 0);
  const Vector2 centre(k[2], k[3]);
  double reached = 0;
  for (const View& v : views) {
    if (v.camera != camera) continue;
    for (const Corner& c : v.corners) {
      const int column =
          std::clamp(static_cast<int>((c.px.x() + 0.5) * map.columns / width_px), 0, map.columns - 1);
      const int row = std::clamp(static_cast<int>((c.px.y() + 0.5) * map.rows / height_px), 0, map.rows - 1);
      ++map.counts[static_cast<std::size_t>(row * map.columns + column)];
      reached = std::max(reached, (c.px - centre).norm());
    }
  }
  double farthest = 0;
  for (const double x : {-0.5, width_px - 0.5})
    for (const double y : {-0.5, height_px - 0.5})
      farthest = std::max(farthest, (Vector2(x, y) - centre).norm());
  map.radius_share = reached / farthest;
  const auto filled = [&](int column, int row) {
    return map.counts[static_cast<std::size_t>(row * map.columns + column)] > 0;
  };
  int cells = 0;
  for (const int n : map.counts) cells += n > 0;
  map.covered_share = static_cast<double>(cells) / static_cast<double>(map.counts.size());
  // The outer quarter of the image on each side, and its corners (2×2 cells), in words.
  const auto share = [&](int c0, int c1, int r0, int r1) {
    int n = 0;
    for (int r = r0; r < r1; ++r)
      for (int c = c0; c < c1; ++c) n += filled(c, r);
    return static_cast<double>(n) / ((c1 - c0) * (r1 - r0));
  };
  const int w = map.columns, h = map.rows;
  const struct {
    const char* name;
    int c0, c1, r0, r1;
  } regions[] = {{"left", 0, 2, 0, h},
                 {"right", w - 2, w, 0, h},
                 {"top", 0, w, 0, 2},
                 {"bottom", 0, w, h - 2, h},
                 {"upper left", 0, 2, 0, 2},
                 {"upper right", w - 2, w, 0, 2},
                 {"lower left", 0, 2, h - 2, h},
                 {"lower right", w - 2, w, h - 2, h},
                 {"middle", w / 2 - 1, w / 2 + 1, h / 2 - 1, h / 2 + 1}};
  for (const auto& r : regions)
    if (share(r.c0, r.c1, r.r0, r.r1) < 0.5) map.thin.push_back(r.name);
  return map;
}

bool folds_over(const CameraModel& m) {
  // d(distorted radius)/d(radius) must stay positive out to the farthest pixel.
  double farthest = 0;
  for (const double x : {-0.5, m.width_px - 0.5})
    for (const double y : {-0.5, m.height_px - 0.5})
      farthest = std::max(farthest, std::hypot((x - m.cx_px) / m.fx_px, (y - m.cy_px) / m.fy_px));
  double distorted = 0;
  for (double r = 0; distorted < farthest && r < 10 * farthest; r += 0.005 * farthest) {
    const double r2 = r * r, slope = 1 + r2 * (3 * m.k1 + r2 * (5 * m.k2 + r2 * 7 * m.k3));
    if (slope <= 0.05) return true;
    distorted = r * (1 + r2 * (m.k1 + r2 * (m.k2 + r2 * m.k3)));
  }
  return false;
}

BoardBend bend_of(const Problem& flat, const State& start, double noise_scale) {
  Problem problem = flat;
  State state = start;
  problem.free_bend = true;
  if (!solve(problem, Loss::kHuber, 4.5, &state)) return {};
  const auto covariance = shared_covariance(reduce(problem, state), noise_scale);
  if (!covariance) return {};
  // Deviation from the best plane at each point, linear in the three numbers of the bend.
  const auto n = static_cast<Eigen::Index>(problem.points.size());
  Eigen::MatrixXd shape(n, kBend), plane(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) {
    const BoardPoint& p = problem.points[static_cast<std::size_t>(i)];
    shape.row(i) << p.u * p.u, p.u * p.v, p.v * p.v;
    plane.row(i) << 1, p.u, p.v;
  }
  shape -= plane * (plane.transpose() * plane).ldlt().solve(plane.transpose() * shape);
  const Eigen::VectorXd deviation = shape * state.bend;
  Eigen::Index worst = 0;
  BoardBend out;
  out.sag_mm = deviation.cwiseAbs().maxCoeff(&worst);
  const Eigen::Matrix3d bend_covariance = covariance->bottomRightCorner<kBend, kBend>();
  out.sigma_mm =
      std::sqrt(std::max(0.0, (shape.row(worst) * bend_covariance * shape.row(worst).transpose()).value()));
  const double tested = state.bend.dot(bend_covariance.ldlt().solve(state.bend));
  out.significant = tested > 30;  // of three degrees of freedom: 1 in a million
  return out;
}

double focal_drift(const std::vector<Reduced>& views, const Vector9& k, double noise_scale) {
  std::vector<double> value, variance;
  for (const Reduced& v : views) {
    Eigen::VectorXd d = Eigen::VectorXd::Zero(v.gradient.size());
    d.head<2>() = k.head<2>();
    const double h = d.dot(v.information * d);
    const double sigma = noise_scale / std::sqrt(std::max(h, 1e-300));
    if (sigma > 0.01) continue;  // a view that says nothing of f
    value.push_back(d.dot(v.gradient) / h);
    variance.push_back(sigma * sigma);
  }
  if (value.size() < 4) return 0;
  // Spread beyond the noise by moments (DerSimonian and Laird 1986).
  double w = 0, w2 = 0, mean = 0, q = 0;
  for (std::size_t i = 0; i < value.size(); ++i) w += 1 / variance[i], w2 += 1 / (variance[i] * variance[i]);
  for (std::size_t i = 0; i < value.size(); ++i) mean += value[i] / variance[i] / w;
  for (std::size_t i = 0; i < value.size(); ++i) q += (value[i] - mean) * (value[i] - mean) / variance[i];
  const double dof = static_cast<double>(value.size()) - 1;
  if (q < dof + 5 * std::sqrt(2 * dof)) return 0;
  return std::sqrt((q - dof) / (w - w2 / w));
}

std::optional<Split> best_split(const Problem& problem, const State& state,
                                const std::vector<Reduced>& views) {
  const std::size_t n = views.size();
  if (n < 2 * kLeastInPart) return std::nullopt;
  Split best;
  double best_saving = 0;
  for (Eigen::Index parameter = 0; parameter < kIntrinsics; ++parameter) {
    std::vector<std::size_t> order(n);
    std::iota(order.begin(), order.end(), 0);
    const auto ask = [&](std::size_t i) {
      return views[i].gradient(parameter) / std::sqrt(views[i].information(parameter, parameter) + 1e-300);
    };
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return ask(a) < ask(b); });
    std::vector<bool> second(n, false);
    for (std::size_t i = n / 2; i < n; ++i) second[order[i]] = true;
    Eigen::VectorXd steps[2];
    double saved = saving(views, second, steps);
    for (int round = 0; round < 30 && saved >= 0; ++round) {
      std::vector<bool> next(n);
      for (std::size_t i = 0; i < n; ++i) {
        double cost[2];
        for (const int part : {0, 1})
          cost[part] =
              0.5 * steps[part].dot(views[i].information * steps[part]) - views[i].gradient.dot(steps[part]);
        next[i] = cost[1] < cost[0];
      }
      if (next == second) break;
      Eigen::VectorXd next_steps[2];
      const double next_saved = saving(views, next, next_steps);
      if (next_saved <= saved) break;
      second = next;
      saved = next_saved;
      steps[0] = next_steps[0], steps[1] = next_steps[1];
    }
    if (saved > best_saving) {
      best_saving = saved;
      best.second = second;
    }
  }
  if (best.second.empty()) return std::nullopt;
  double sum = 0, count = 0;
  Vector9 intrinsics[2];
  Eigen::MatrixXd covariances[2];
  for (const bool part : {false, true}) {
    Problem half = problem;
    std::erase_if(half.views, [&](const View& v) { return best.second[v.instant] != part; });
    State alone = state;
    if (!solve(half, Loss::kHuber, 4.5, &alone)) return std::nullopt;
    for (const View& v : half.views)
      for (const Corner& c : v.corners)
        if (const auto r = residual(half, alone, v, c)) sum += r->squaredNorm(), ++count;
    best.focal_px[part] = alone.intrinsics[0].head<2>().mean();
    intrinsics[part] = alone.intrinsics[0];
    const auto covariance = shared_covariance(reduce(half, alone), 1);
    if (!covariance) return std::nullopt;
    covariances[part] = *covariance;
  }
  best.rms_apart_px = std::sqrt(sum / count);
  best.rms_together_px = rms_px(problem, state, -1);
  const Vector9 difference = intrinsics[0] - intrinsics[1];
  Matrix9 both = covariances[0] + covariances[1];
  for (int i = 0; i < kIntrinsics; ++i) both(i, i) += 1e-18;
  best.separation_sigmas = std::sqrt(std::max(0.0, difference.dot(both.ldlt().solve(difference))));
  return best;
}

}  // namespace gnathion::camera_problem
