#include "tracking/analysis/jaw_scene.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

namespace gnathion {

std::pair<std::size_t, std::size_t> JawScene::rows(double start_s, double end_s) const {
  const auto& t = *time_s;
  const auto first = std::lower_bound(t.begin(), t.end(), start_s - 1e-9);
  const auto last = std::upper_bound(t.begin(), t.end(), end_s + 1e-9);
  const auto i = std::min(first - t.begin(), static_cast<std::ptrdiff_t>(t.size()) - 1);
  return {static_cast<std::size_t>(i), static_cast<std::size_t>(std::max(last - t.begin() - 1, i))};
}

bool JawScene::seen_at(double time) const {
  const auto& t = *time_s;
  const auto after = std::upper_bound(t.begin(), t.end(), time);
  return after != t.begin() && after != t.end() && *after - *(after - 1) <= gap_s;
}

namespace {

/// Value at a time of what `at_row` gives at rows, by least squares of a quadratic over ±half_window_s.
template <class AtRow>
Vector3 local_value(const JawScene& scene, double time, double half_window_s, const AtRow& at_row) {
  const auto [first, last] = scene.rows(time - half_window_s, time + half_window_s);
  Matrix3 n = Matrix3::Zero(), b = Matrix3::Zero();
  std::size_t used = 0;
  for (std::size_t i = first; i <= last; ++i) {
    const double u = ((*scene.time_s)[i] - time) / half_window_s;
    if (std::abs(u) > 1 + 1e-6) continue;
    const Vector3 powers(1, u, u * u);
    n += powers * powers.transpose();
    b += powers * at_row(i).transpose();
    ++used;
  }
  if (used >= 5) return (n.ldlt().solve(b)).row(0).transpose();
  // Too few rows for a quadratic (a low rate, the edge of a gap): the line between the neighbours.
  const auto& t = *scene.time_s;
  const std::size_t after = std::clamp<std::size_t>(
      static_cast<std::size_t>(std::lower_bound(t.begin(), t.end(), time) - t.begin()), 1, t.size() - 1);
  const double f = std::clamp((time - t[after - 1]) / (t[after] - t[after - 1]), 0.0, 1.0);
  return (1 - f) * at_row(after - 1) + f * at_row(after);
}

}  // namespace

Vector3 JawScene::displacement_at(const Vector3& point_mm, double time, double half_window) const {
  return local_value(*this, time, half_window,
                     [&](std::size_t i) -> Vector3 { return displacement(point_mm, i); });
}

double JawScene::opening_rad_at(double time) const {
  return local_value(*this, time, half_window_s,
                     [&](std::size_t i) -> Vector3 { return log_so3(mandible[i].rotation); })
      .dot(landmarks.plane.left);
}

Peak peak_of(const JawScene& scene, const Vector3& point_mm, double start_s, double end_s,
             const Measure& measure) {
  const auto [first, last] = scene.rows(start_s, end_s);
  const auto value = [&](std::size_t i) {
    return measure(scene.displacement_at(point_mm, (*scene.time_s)[i], 1.6 * scene.half_window_s));
  };
  std::size_t top = first;
  double best = -1e300;
  for (std::size_t i = first; i <= last; ++i)
    if (const double v = value(i); v > best) best = v, top = i;
  Peak peak{best, (*scene.time_s)[top]};
  if (top > first && top < last) {
    const double t0 = (*scene.time_s)[top - 1] - peak.time_s, t2 = (*scene.time_s)[top + 1] - peak.time_s;
    const double d0 = (value(top - 1) - best) / t0, d2 = (value(top + 1) - best) / t2;
    const double curvature = (d2 - d0) / (t2 - t0), slope = d0 - curvature * t0;
    if (curvature < 0) peak.time_s += std::clamp(-0.5 * slope / curvature, t0, t2);
  }
  peak.value = measure(scene.displacement_at(point_mm, peak.time_s, 0.7 * scene.half_window_s));
  return peak;
}

const JawSegment* largest_of(const JawScene& scene, const std::vector<JawSegment>& segments,
                             JawMovement movement) {
  const JawSegment* largest = nullptr;
  double reach = 0;
  for (const JawSegment& s : segments) {
    if (s.movement != movement) continue;
    const double r = scene.displacement_at(scene.landmarks.incisal_mm, s.turn_s).norm();
    if (largest == nullptr || r > reach) largest = &s, reach = r;
  }
  return largest;
}

}  // namespace gnathion
