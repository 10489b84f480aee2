#include "acquisition/temporal_calibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot find the offset in time";
constexpr double kStepS = 0.005;      // of the common grid; the kernel is at least four times as wide
constexpr double kReachSigmas = 3.0;  // of the kernel
constexpr double kLeastCorrelation = 0.7;
constexpr double kLeastUnexplained = 1e-3;  // share of variance below which peaks are equally good
constexpr std::size_t kCandidates = 4;      // peaks of the correlation that are refined

/// A signal on the common grid: value k at k · kStepS after the reference time.
struct Grid {
  std::vector<double> value;
  std::vector<char> valid;
};

double seconds(HostTime t, HostTime reference) {
  return t.seconds_since(reference);
}

/// Rate of change at `t_s` by a quadratic fitted to the neighbours, weighted by a Gaussian kernel: unbiased
/// where samples are unequally spaced. Nothing where there are too few, or only on one side. `value_of` gives
/// the neighbour's coordinates relative to the one nearest to t_s.
template <class ValueOf>
std::optional<double> local_rate(const std::vector<double>& times_s, double t_s, double sigma_s,
                                 const ValueOf& value_of) {
  const auto low = std::lower_bound(times_s.begin(), times_s.end(), t_s - kReachSigmas * sigma_s);
  const auto high = std::upper_bound(low, times_s.end(), t_s + kReachSigmas * sigma_s);
  const auto near = std::lower_bound(low, high, t_s);
  const auto within = [&](auto it) { return std::abs(*it - t_s) <= 1.5 * sigma_s; };
  if (high - low < 4 || near == high || near == low || !within(near) || !within(near - 1))
    return std::nullopt;
  const auto nearest = static_cast<std::size_t>(near - times_s.begin());
  Matrix3 normal = Matrix3::Zero();
  Matrix3 moments = Matrix3::Zero();  // rows: powers of time; columns: coordinates
  for (auto it = low; it != high; ++it) {
    const double u = (*it - t_s) / sigma_s;
    const double w = std::exp(-0.5 * u * u);
    const Vector3 powers(1, u, u * u);
    normal += w * powers * powers.transpose();
    moments += w * powers * value_of(static_cast<std::size_t>(it - times_s.begin()), nearest).transpose();
  }
  if (std::abs(normal.determinant()) < 1e-9 * std::pow(normal.trace(), 3)) return std::nullopt;
  const Matrix3 fit = normal.inverse() * moments;
  return fit.row(1).norm() / sigma_s;
}

template <class ValueOf>
Grid rates(const std::vector<double>& times_s, double sigma_s, const ValueOf& value_of) {
  Grid grid;
  const auto first = static_cast<std::ptrdiff_t>(std::ceil(times_s.front() / kStepS));
  const auto last = static_cast<std::ptrdiff_t>(std::floor(times_s.back() / kStepS));
  grid.value.assign(static_cast<std::size_t>(last + 1), 0);
  grid.valid.assign(static_cast<std::size_t>(last + 1), 0);
  for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(first, 0); k <= last; ++k)
    if (const auto rate = local_rate(times_s, static_cast<double>(k) * kStepS, sigma_s, value_of)) {
      grid.value[static_cast<std::size_t>(k)] = *rate;
      grid.valid[static_cast<std::size_t>(k)] = 1;
    }
  return grid;
}

double median_period(const std::vector<double>& times_s) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < times_s.size(); ++i) steps.push_back(times_s[i] - times_s[i - 1]);
  std::nth_element(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2), steps.end());
  return steps[steps.size() / 2];
}

/// Correlation of a(t) with b(t − lag) over the grid's common valid times.
struct Match {
  double correlation = 0;
  std::size_t count = 0;
};

Match match_at(const Grid& a, const Grid& b, std::ptrdiff_t lag) {
  double sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  std::size_t n = 0;
  const auto na = static_cast<std::ptrdiff_t>(a.value.size()),
             nb = static_cast<std::ptrdiff_t>(b.value.size());
  for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, lag); k < std::min(na, nb + lag); ++k) {
    const auto i = static_cast<std::size_t>(k), j = static_cast<std::size_t>(k - lag);
    if (!a.valid[i] || !b.valid[j]) continue;
    const double x = a.value[i], y = b.value[j];
    sa += x, sb += y, saa += x * x, sbb += y * y, sab += x * y;
    ++n;
  }
  if (n < 3) return {0, n};
  const double d = static_cast<double>(n);
  const double va = saa - sa * sa / d, vb = sbb - sb * sb / d;
  if (va <= 0 || vb <= 0) return {0, n};
  return {(sab - sa * sb / d) / std::sqrt(va * vb), n};
}

/// b and its slope between grid points (cubic, Catmull and Rom).
bool interpolate(const Grid& b, double t_s, double* value, double* slope) {
  const double x = t_s / kStepS;
  const double floor_x = std::floor(x);
  const auto i = static_cast<std::ptrdiff_t>(floor_x);
  if (i < 1 || i + 2 >= static_cast<std::ptrdiff_t>(b.value.size())) return false;
  const std::size_t k = static_cast<std::size_t>(i);
  if (!(b.valid[k - 1] && b.valid[k] && b.valid[k + 1] && b.valid[k + 2])) return false;
  const double p = b.value[k - 1], q = b.value[k], r = b.value[k + 1], s = b.value[k + 2], u = x - floor_x;
  const double c1 = 0.5 * (r - p), c2 = p - 2.5 * q + 2 * r - 0.5 * s, c3 = 0.5 * (s - p) + 1.5 * (q - r);
  *value = q + u * (c1 + u * (c2 + u * c3));
  *slope = (c1 + u * (2 * c2 + 3 * u * c3)) / kStepS;
  return true;
}

struct Refined {
  double offset_s = 0, sigma_s = 0, correlation = 0, overlap_s = 0;
  bool converged = false;
};

/// Pairs a(t) with b(t − offset) and its slope.
struct Pairs {
  std::vector<double> a, b, slope;
};
Pairs pairs_at(const Grid& a, const Grid& b, double offset_s) {
  Pairs p;
  for (std::size_t k = 0; k < a.value.size(); ++k) {
    double value = 0, slope = 0;
    if (!a.valid[k] || !interpolate(b, static_cast<double>(k) * kStepS - offset_s, &value, &slope)) continue;
    p.a.push_back(a.value[k]);
    p.b.push_back(value);
    p.slope.push_back(slope);
  }
  return p;
}

/// Least squares a(t) = gain · b(t − offset) + bias by Gauss and Newton. The variance of the offset is the
/// sandwich with Bartlett's weights (Newey and West 1987), because smoothed residuals are not independent.
Refined refine(const Grid& a, const Grid& b, double offset_s, double sigma_kernel_s) {
  Refined out;
  out.offset_s = offset_s;
  for (int round = 0; round < 15; ++round) {
    const Pairs p = pairs_at(a, b, out.offset_s);
    const std::size_t n = p.a.size();
    if (n < 10) return out;
    out.overlap_s = static_cast<double>(n) * kStepS;
    Eigen::Matrix<double, Eigen::Dynamic, 3> design(n, 3);
    Eigen::Map<const Eigen::VectorXd> target(p.a.data(), static_cast<Eigen::Index>(n));
    const Eigen::Map<const Eigen::VectorXd> value(p.b.data(), static_cast<Eigen::Index>(n));
    const Eigen::Map<const Eigen::VectorXd> slope(p.slope.data(), static_cast<Eigen::Index>(n));
    design.col(0) = value;
    design.col(1).setOnes();
    design.col(2) = -slope;  // d b(t − offset) / d offset, times the gain
    const Matrix3 normal = design.transpose() * design;
    const Eigen::LDLT<Matrix3> solver(normal);
    const Vector3 solution = solver.solve(design.transpose() * target);
    const double gain = solution(0);
    if (!(gain > 0) || !solution.allFinite()) return out;
    const double step_s = std::clamp(solution(2) / gain, -0.02, 0.02);
    out.offset_s += step_s;
    if (std::abs(step_s) > 1e-7) continue;
    const Eigen::VectorXd residual = target - design * solution;
    const Eigen::VectorXd score_of = design * solver.solve(Vector3::UnitZ());
    const Eigen::VectorXd score = score_of.cwiseProduct(residual);
    double variance = score.squaredNorm();
    const auto lags = static_cast<Eigen::Index>(4 * sigma_kernel_s / kStepS);
    for (Eigen::Index lag = 1; lag <= lags && lag < score.size(); ++lag)
      variance += 2 * (1 - static_cast<double>(lag) / static_cast<double>(lags + 1)) *
                  score.head(score.size() - lag).dot(score.tail(score.size() - lag));
    out.sigma_s = std::sqrt(std::max(variance, 0.0)) / gain;
    const Eigen::VectorXd centred = target.array() - target.mean();
    out.correlation = std::sqrt(std::max(0.0, 1 - residual.squaredNorm() / centred.squaredNorm()));
    out.converged = true;
    return out;
  }
  return out;
}

/// Local maxima of the correlation over the lags, best first.
std::vector<std::ptrdiff_t> peaks(const std::vector<Match>& matches, std::size_t least,
                                  std::ptrdiff_t reach) {
  std::vector<std::ptrdiff_t> found;
  for (std::ptrdiff_t lag = -reach; lag <= reach; ++lag) {
    const auto at = [&](std::ptrdiff_t l) -> const Match& {
      return matches[static_cast<std::size_t>(l + reach)];
    };
    if (at(lag).count < least || at(lag).correlation <= 0) continue;
    const bool rises = lag == -reach || at(lag - 1).correlation < at(lag).correlation;
    const bool falls = lag == reach || at(lag + 1).correlation <= at(lag).correlation;
    if (rises && falls) found.push_back(lag);
  }
  std::stable_sort(found.begin(), found.end(), [&](std::ptrdiff_t x, std::ptrdiff_t y) {
    return matches[static_cast<std::size_t>(x + reach)].correlation >
           matches[static_cast<std::size_t>(y + reach)].correlation;
  });
  return found;
}

tl::unexpected<Error> undetermined(const std::string& why) {
  return fail(ErrorCode::kGate, kWhat, "motion", "the motion does not determine the offset: " + why);
}

Result<TemporalCalibration> align(const Grid& a, const Grid& b, double sigma_s,
                                  const TemporalCalibrationOptions& options) {
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(options.max_offset_s / kStepS));
  const auto least = static_cast<std::size_t>(options.min_overlap_s / kStepS);
  std::vector<Match> matches;
  std::size_t most = 0;
  for (std::ptrdiff_t lag = -reach; lag <= reach; ++lag) {
    matches.push_back(match_at(a, b, lag));
    most = std::max(most, matches.back().count);
  }
  if (most < least)
    return undetermined(fmt::format("{:.1f} s of it are in both streams, {:.1f} s are needed",
                                    static_cast<double>(most) * kStepS, options.min_overlap_s));
  const std::vector<std::ptrdiff_t> candidates = peaks(matches, least, reach);
  const auto correlation_of = [&](std::ptrdiff_t lag) {
    return matches[static_cast<std::size_t>(lag + reach)].correlation;
  };
  if (candidates.empty() || correlation_of(candidates.front()) < kLeastCorrelation)
    return undetermined(fmt::format("it is too slow, or not the same in both (correlation {:.2f})",
                                    candidates.empty() ? 0.0 : correlation_of(candidates.front())));
  if (std::abs(candidates.front()) == reach)
    return undetermined(fmt::format("the best match lies beyond the search of ±{} s", options.max_offset_s));
  const Refined best = refine(a, b, static_cast<double>(candidates.front()) * kStepS, sigma_s);
  if (!best.converged ||
      std::abs(best.offset_s - static_cast<double>(candidates.front()) * kStepS) > 2 * kStepS)
    return undetermined("the correlation has no definite peak");
  TemporalCalibration out{best.offset_s, std::max(best.sigma_s, 1e-5), best.correlation, 0, best.overlap_s};

  // A second offset that explains the streams as well: the residual variances must differ by more than chance
  // would have it, and by more than a motion that repeats itself not quite exactly would.
  const auto unexplained = [](double r) { return std::max(1 - r * r, kLeastUnexplained); };
  const double independent = best.overlap_s / (4 * sigma_s);
  const double needed = std::max(1.0, 10 / std::sqrt(independent));
  for (std::size_t i = 1; i < std::min(candidates.size(), kCandidates); ++i) {
    const Refined other = refine(a, b, static_cast<double>(candidates[i]) * kStepS, sigma_s);
    const double r = other.converged ? other.correlation : correlation_of(candidates[i]);
    if (other.converged && std::abs(other.offset_s - best.offset_s) < 2 * kStepS) continue;
    out.runner_up = std::max(out.runner_up, r);
    if (std::log(unexplained(r) / unexplained(best.correlation)) < needed)
      return undetermined(fmt::format(
          "it repeats itself: {:.1f} ms and {:.1f} ms explain it alike", best.offset_s * 1e3,
          (other.converged ? other.offset_s : static_cast<double>(candidates[i]) * kStepS) * 1e3));
  }
  if (out.sigma_s > options.max_sigma_s)
    return undetermined(fmt::format("σ = {:.2f} ms, {:.2f} ms are asked; move faster and longer",
                                    out.sigma_s * 1e3, options.max_sigma_s * 1e3));
  return out;
}

/// Sorted by time, one sample an instant.
template <class T>
std::vector<T> in_order(std::vector<T> samples) {
  std::stable_sort(samples.begin(), samples.end(), [](const T& x, const T& y) { return x.time < y.time; });
  samples.erase(
      std::unique(samples.begin(), samples.end(), [](const T& x, const T& y) { return x.time == y.time; }),
      samples.end());
  return samples;
}

template <class T, class MakeValueOf>
Result<TemporalCalibration> calibrate(const std::vector<T>& first, const std::vector<T>& second,
                                      const TemporalCalibrationOptions& options,
                                      const MakeValueOf& value_of) {
  const std::vector<T> a = in_order(first), b = in_order(second);
  if (a.size() < 10 || b.size() < 10)
    return undetermined(fmt::format("{} and {} samples", a.size(), b.size()));
  const HostTime reference = std::min(a.front().time, b.front().time);
  std::vector<double> a_s, b_s;
  for (const T& x : a) a_s.push_back(seconds(x.time, reference));
  for (const T& x : b) b_s.push_back(seconds(x.time, reference));
  if (std::max(a_s.back(), b_s.back()) > 3600)
    return bad_input(kWhat, "motion", "more than an hour of it, or streams of different days");
  // The same kernel for both, wide enough for the slower one.
  const double sigma_s = std::max({options.smoothing_s, median_period(a_s), median_period(b_s)});
  return align(rates(a_s, sigma_s, value_of(a)), rates(b_s, sigma_s, value_of(b)), sigma_s, options);
}

}  // namespace

Result<TemporalCalibration> calibrate_time_offset(const std::vector<TimedPose>& first,
                                                  const std::vector<TimedPose>& second,
                                                  const TemporalCalibrationOptions& options) {
  return calibrate(first, second, options, [](const std::vector<TimedPose>& poses) {
    return [&poses](std::size_t i, std::size_t nearest) {
      return log_so3(poses[i].pose.rotation * poses[nearest].pose.rotation.transpose());
    };
  });
}

Result<TemporalCalibration> calibrate_time_offset(const std::vector<TimedValue>& first,
                                                  const std::vector<TimedValue>& second,
                                                  const TemporalCalibrationOptions& options) {
  return calibrate(first, second, options, [](const std::vector<TimedValue>& values) {
    return [&values](std::size_t i, std::size_t nearest) {
      return Vector3(values[i].value - values[nearest].value, 0, 0);
    };
  });
}

}  // namespace gnathion
