#include "acquisition/clock_estimator.h"

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

constexpr std::size_t kPoints = 64;       // the regression's memory, in stretches of window / 60
constexpr std::size_t kResiduals = 256;   // pairs over which the jitter is measured
constexpr std::size_t kFewPoints = 4;     // below, drift is a matter of prior knowledge
constexpr double kLateForS = 2.0;         // arrivals late for so long are a clock that jumped, not a stall
constexpr int kAgreeing = 3;              // as many pairs that agree are a jump, fewer are glitches
constexpr double kTukey = 4.685;          // 95 % efficiency for normal residuals
constexpr double kLeastScaleNs = 1000.0;  // no arrival is known better than this
constexpr double kMad = 1.4826;           // median absolute deviation → standard deviation

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

ClockEstimator::ClockEstimator(Options options) : options_(options) {}

HostTime ClockEstimator::add(DeviceTime device, HostTime arrival) {
  const Point pair{device.ns, arrival.ns - device.ns};
  ++estimate_.samples;
  if (!estimate_.known) restart(pair);
  const std::int64_t residual_ns = pair.delay_ns - line_delay_ns(device.ns);
  const Kind kind = judge(pair, residual_ns);
  if (kind == Kind::kJumped) {
    ++estimate_.restarts;
    if (static_cast<double>(last_host_ns_ - arrival.ns) > 0.5e9 * options_.jump_s)
      last_host_ns_ = INT64_MIN;  // the host's own clock was set back
    restart(held_.earliest);
    held_ = {};
  }
  if (kind == Kind::kUsual) take(pair, residual_ns);
  if (kind == Kind::kLate || kind == Kind::kOdd) ++estimate_.outliers;
  // Where the device's time makes no sense, arrival is all there is.
  const std::int64_t host_ns = kind == Kind::kOdd ? arrival.ns : device.ns + line_delay_ns(device.ns);
  const HostTime out = monotone(host_ns - options_.latency_ns, device.ns, arrival.ns);
  if (kind != Kind::kOdd) last_device_ns_ = device.ns;
  return out;
}

std::optional<HostTime> ClockEstimator::host_from_device(DeviceTime device) const {
  if (!estimate_.known) return std::nullopt;
  const std::int64_t host_ns = device.ns + line_delay_ns(device.ns) - options_.latency_ns;
  if (last_host_ns_ == INT64_MIN) return HostTime{host_ns};
  if (device.ns <= last_device_ns_) return HostTime{std::min(host_ns, last_host_ns_)};
  return HostTime{std::max(host_ns, last_host_ns_ + (device.ns - last_device_ns_) / 10)};
}

std::int64_t ClockEstimator::line_delay_ns(std::int64_t device_ns) const {
  const double since_ns = static_cast<double>(device_ns - estimate_.reference_ns);
  return std::llround(estimate_.offset_ns) + std::llround(estimate_.drift_ppm * 1e-6 * since_ns);
}

/// Nothing is captured after it arrived, and the capture times of a stream go back only where the arrivals do
/// (the host's clock was set back by less than a jump). Where the line was too late, time goes on at a tenth
/// of its pace until it is right again.
HostTime ClockEstimator::monotone(std::int64_t candidate_ns, std::int64_t device_ns,
                                  std::int64_t arrival_ns) {
  std::int64_t host_ns = candidate_ns;
  if (last_host_ns_ != INT64_MIN) {
    const std::int64_t jump_ns = std::llround(options_.jump_s * 1e9);
    const std::int64_t step_ns = device_ns - last_device_ns_;
    host_ns = std::max(host_ns, last_host_ns_ + (step_ns > 0 && step_ns < jump_ns ? step_ns / 10 : 1000));
  }
  host_ns = std::min(host_ns, arrival_ns - options_.latency_ns);
  if (last_host_ns_ != INT64_MIN) host_ns = std::max(host_ns, last_host_ns_ + 1);
  host_ns = std::min(host_ns, arrival_ns);
  last_host_ns_ = host_ns;
  return {host_ns};
}

ClockEstimator::Kind ClockEstimator::judge(Point pair, std::int64_t residual_ns) {
  const std::int64_t jump_ns = std::llround(options_.jump_s * 1e9);
  if (std::abs(residual_ns) <= jump_ns) {
    held_ = {};
    return Kind::kUsual;
  }
  const bool late = residual_ns > 0 && pair.device_ns > last_device_ns_;
  if (held_.count == 0 || std::abs(pair.delay_ns - held_.first.delay_ns) > jump_ns / 2)
    held_ = {pair, pair, 0};
  ++held_.count;
  if (pair.delay_ns < held_.earliest.delay_ns) held_.earliest = pair;
  const double held_s = 1e-9 * static_cast<double>(pair.device_ns - held_.first.device_ns);
  if (held_.count >= kAgreeing && (!late || held_s >= kLateForS)) return Kind::kJumped;
  return late ? Kind::kLate : Kind::kOdd;
}

void ClockEstimator::restart(Point from) {
  points_.clear();
  open_ = from;
  open_begin_ns_ = from.device_ns;
  residuals_ms_.clear();
  next_residual_ = 0;
  estimate_.known = true;
  fit();
}

void ClockEstimator::take(Point pair, std::int64_t residual_ns) {
  const double residual_ms = 1e-6 * static_cast<double>(residual_ns);
  if (residuals_ms_.size() >= 16 &&
      residual_ms - residual_median_ms_ > std::max(6 * estimate_.jitter_ms, 1.0))
    ++estimate_.outliers;
  if (residuals_ms_.size() < kResiduals)
    residuals_ms_.push_back(residual_ms);
  else
    residuals_ms_[next_residual_++ % kResiduals] = residual_ms;

  const auto stretch_ns = static_cast<std::int64_t>(options_.window_s * 1e9 / 60);
  if (open_ && pair.device_ns - open_begin_ns_ >= stretch_ns) {
    points_.push_back(*open_);
    const auto window_ns = static_cast<std::int64_t>(options_.window_s * 1e9);
    while (points_.size() > kPoints || points_.front().device_ns < points_.back().device_ns - window_ns)
      points_.pop_front();
    open_.reset();
    fit();
  }
  if (!open_) {
    open_ = pair;
    open_begin_ns_ = pair.device_ns;
    return;
  }
  // Earliest but for the drift within the stretch.
  const double drift_ns = estimate_.drift_ppm * 1e-6 * static_cast<double>(pair.device_ns - open_->device_ns);
  if (static_cast<double>(pair.delay_ns - open_->delay_ns) >= drift_ns) return;
  open_ = pair;
  if (points_.size() < kFewPoints) fit();
}

void ClockEstimator::fit() {
  drop_points_before_a_step();
  fit_line();
  fit_jitter();
}

/// The delay changed for good (the host's clock was set, a hub was put between): two seconds that all lie on
/// one side, far off, end the memory of what was before.
void ClockEstimator::drop_points_before_a_step() {
  if (points_.size() < 2 * kFewPoints) return;
  std::vector<double> off_ns, size_ns;
  for (const Point& p : points_) {
    off_ns.push_back(static_cast<double>(p.delay_ns - line_delay_ns(p.device_ns)));
    size_ns.push_back(std::abs(off_ns.back()));
  }
  const double far_ns = std::max(8 * kMad * median(size_ns), 3e6);
  const auto last = off_ns.end() - kFewPoints;
  const bool later = std::all_of(last, off_ns.end(), [&](double d) { return d > far_ns; });
  const bool earlier = std::all_of(last, off_ns.end(), [&](double d) { return d < -far_ns; });
  if (!later && !earlier) return;
  points_.erase(points_.begin(), points_.end() - kFewPoints);
  residuals_ms_.clear();
  next_residual_ = 0;
  ++estimate_.restarts;
}

/// Iteratively reweighted least squares (Tukey) from Theil and Sen's slope, with what is known of the crystal
/// as a prior: drift changes slowly, and cheap crystals are within 100 ppm.
void ClockEstimator::fit_line() {
  std::vector<Point> points(points_.begin(), points_.end());
  if (points.size() < kFewPoints && open_) points.push_back(*open_);
  if (points.empty()) return;
  const Point origin = points.back();
  const std::size_t n = points.size();
  std::vector<double> x_s(n), y_ns(n), slopes, work;
  for (std::size_t i = 0; i < n; ++i) {
    x_s[i] = 1e-9 * static_cast<double>(points[i].device_ns - origin.device_ns);
    y_ns[i] = static_cast<double>(points[i].delay_ns - origin.delay_ns);
    for (std::size_t j = 0; j < i; ++j)
      if (x_s[i] > x_s[j]) slopes.push_back((y_ns[i] - y_ns[j]) / (x_s[i] - x_s[j]));
  }
  const double limit = options_.max_drift_ppm * 1e3;  // 1 ppm = 1000 ns/s
  const double prior = drift_prior_ppm_ * 1e3, prior_sigma = drift_prior_sigma_ppm_ * 1e3;
  const bool few = n <= kFewPoints;
  double slope = !few && !slopes.empty() ? std::clamp(median(slopes), -limit, limit) : prior;
  for (std::size_t i = 0; i < n; ++i) work.push_back(y_ns[i] - slope * x_s[i]);
  // At the start much may be late at once: the earliest arrival is all there is to go by.
  double level = few ? *std::min_element(work.begin(), work.end()) : median(work);
  for (int round = 0; round < 5 && !few; ++round) {
    for (std::size_t i = 0; i < n; ++i) work[i] = std::abs(y_ns[i] - slope * x_s[i] - level);
    std::vector<double> sizes = work;
    const double scale = std::max(kMad * median(sizes), kLeastScaleNs);
    double sw = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const double u = work[i] / (kTukey * scale);
      const double w = u < 1 ? (1 - u * u) * (1 - u * u) : 0;
      sw += w, sx += w * x_s[i], sy += w * y_ns[i];
      sxx += w * x_s[i] * x_s[i], sxy += w * x_s[i] * y_ns[i];
    }
    if (sw <= 0) break;
    const double stiffness = (scale / prior_sigma) * (scale / prior_sigma);
    slope = (sxy - sx * sy / sw + stiffness * prior) / (sxx - sx * sx / sw + stiffness);
    slope = std::clamp(slope, -limit, limit);
    level = (sy - slope * sx) / sw;
  }
  estimate_.reference_ns = origin.device_ns;
  estimate_.offset_ns = static_cast<double>(origin.delay_ns) + level;
  estimate_.drift_ppm = slope * 1e-3;
  if (x_s.front() < -0.5 * options_.window_s) {
    drift_prior_ppm_ = estimate_.drift_ppm;  // the same crystal after a restart, warmer or colder
    drift_prior_sigma_ppm_ = 20;
  }
}

void ClockEstimator::fit_jitter() {
  if (residuals_ms_.size() < 2) return;
  std::vector<double> work = residuals_ms_;
  residual_median_ms_ = median(work);
  for (double& r : work) r = std::abs(r - residual_median_ms_);
  estimate_.jitter_ms = kMad * median(work);
}

}  // namespace gnathion
