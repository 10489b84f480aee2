#include "occlusion/horseshoe.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace gnathion {
namespace {

constexpr double kPi = std::numbers::pi;

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

double percentile(std::vector<double>& values, double q) {
  const auto k = static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + k, values.end());
  return values[static_cast<std::size_t>(k)];
}

/// Angle from −y (anterior), positive towards +x; −π..π.
double polar_angle(const Eigen::Vector2d& d) {
  return std::atan2(d.x(), -d.y());
}

/// Distances from the centre, sorted into equal sectors of the full circle.
std::vector<std::vector<double>> radii_by_sector(const std::vector<Eigen::Vector2d>& points,
                                                 const Eigen::Vector2d& centre, std::size_t sectors) {
  std::vector<std::vector<double>> radii(sectors);
  for (const auto& p : points) {
    const Eigen::Vector2d d = p - centre;
    const double turn = (polar_angle(d) + kPi) / (2.0 * kPi) * static_cast<double>(sectors);
    radii[std::min(sectors - 1, static_cast<std::size_t>(std::max(0.0, turn)))].push_back(d.norm());
  }
  return radii;
}

/// r(φ) as a polynomial in φ, least squares weighted by the number of points in each sector.
Eigen::VectorXd fit_radius(const std::vector<double>& phi, const std::vector<double>& r,
                           const std::vector<double>& weight, int degree) {
  const auto n = static_cast<Eigen::Index>(phi.size());
  Eigen::MatrixXd a(n, degree + 1);
  Eigen::VectorXd b(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    double power = weight[k];
    for (int d = 0; d <= degree; ++d, power *= phi[k]) a(i, d) = power;
    b(i) = weight[k] * r[k];
  }
  return a.colPivHouseholderQr().solve(b);
}

std::vector<Eigen::Vector2d> resampled(const std::vector<Eigen::Vector2d>& line, double step) {
  std::vector<double> s(line.size(), 0.0);
  for (std::size_t i = 1; i < line.size(); ++i) s[i] = s[i - 1] + (line[i] - line[i - 1]).norm();
  const auto pieces = static_cast<std::size_t>(std::max(1.0, std::round(s.back() / step)));
  std::vector<Eigen::Vector2d> out;
  std::size_t k = 0;
  for (std::size_t i = 0; i <= pieces; ++i) {
    const double at = s.back() * static_cast<double>(i) / static_cast<double>(pieces);
    while (k + 2 < line.size() && s[k + 1] < at) ++k;
    const double f = std::clamp((at - s[k]) / std::max(1e-12, s[k + 1] - s[k]), 0.0, 1.0);
    out.push_back(line[k] + f * (line[k + 1] - line[k]));
  }
  return out;
}

/// Appends the point straight ahead that is level with the farthest crown beside the line's end.
void extend_to_crowns(const std::vector<Eigen::Vector2d>& points, std::vector<Eigen::Vector2d>& line) {
  const Eigen::Vector2d end = line.back(), ahead = (end - line[line.size() - 20]).normalized();
  double reach = 0.0;
  for (const auto& p : points)
    if (std::abs(cross(ahead, p - end)) < 6.0) reach = std::max(reach, ahead.dot(p - end));
  if (reach > 0.1) line.push_back(end + reach * ahead);
}

}  // namespace

Eigen::Vector2d hull_centroid(std::vector<Eigen::Vector2d> points) {
  std::sort(points.begin(), points.end(), [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() < b.x() || (a.x() == b.x() && a.y() < b.y());
  });
  std::vector<Eigen::Vector2d> hull;  // Andrew's monotone chain
  for (int pass = 0; pass < 2; ++pass) {
    const std::size_t start = hull.size();
    for (const auto& p : points) {
      while (hull.size() >= start + 2 && cross(hull.back() - hull[hull.size() - 2], p - hull.back()) <= 0.0)
        hull.pop_back();
      hull.push_back(p);
    }
    hull.pop_back();
    std::reverse(points.begin(), points.end());
  }
  const Eigen::Vector2d origin = hull.empty() ? Eigen::Vector2d::Zero().eval() : hull.front();
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double area = 0.0;
  for (std::size_t i = 1; i + 1 < hull.size(); ++i) {
    const Eigen::Vector2d a = hull[i] - origin, b = hull[i + 1] - origin;
    const double w = cross(a, b);
    sum += w * (a + b) / 3.0;
    area += w;
  }
  return area > 0.0 ? (origin + sum / area).eval() : origin;
}

Opening find_opening(const std::vector<Eigen::Vector2d>& points, const Eigen::Vector2d& centre) {
  constexpr std::size_t kSectors = 120;  // 3°
  const auto radii = radii_by_sector(points, centre, kSectors);
  std::vector<double> counts;
  for (const auto& r : radii)
    if (!r.empty()) counts.push_back(static_cast<double>(r.size()));
  if (counts.empty()) return {};
  const double few = 0.05 * percentile(counts, 0.5);
  std::size_t best = 0, best_end = 0, run = 0;
  for (std::size_t i = 0; i < 2 * kSectors; ++i) {  // twice round, for the run over the seam
    run = static_cast<double>(radii[i % kSectors].size()) <= few ? run + 1 : 0;
    if (run > best && run <= kSectors) {
      best = run;
      best_end = i + 1;
    }
  }
  const double sector = 2.0 * kPi / static_cast<double>(kSectors);
  const double from_anterior =
      (static_cast<double>(best_end) - 0.5 * static_cast<double>(best)) * sector - kPi;
  // polar_angle counts from −y towards +x; back to the usual angle from +x towards +y.
  return {from_anterior - 0.5 * kPi, static_cast<double>(best) * sector};
}

std::optional<std::vector<Eigen::Vector2d>> middle_curve(const std::vector<Eigen::Vector2d>& points,
                                                         const Eigen::Vector2d& centre, double step_mm) {
  constexpr std::size_t kSectors = 180;  // 2°
  auto radii = radii_by_sector(points, centre, kSectors);
  std::vector<double> phi, r, weight;
  for (std::size_t i = 0; i < kSectors; ++i) {
    if (radii[i].size() < 6) continue;
    const double angle = (static_cast<double>(i) + 0.5) * 2.0 * kPi / kSectors - kPi;
    if (std::abs(angle) > 0.85 * kPi) continue;
    phi.push_back(angle);
    r.push_back(0.5 * (percentile(radii[i], 0.05) + percentile(radii[i], 0.95)));
    weight.push_back(std::sqrt(static_cast<double>(radii[i].size())));
  }
  if (phi.size() < 24) return std::nullopt;
  const double span = phi.back() - phi.front();
  if (static_cast<double>(phi.size()) < 0.5 * span / (2.0 * kPi / kSectors)) return std::nullopt;

  // The rays from the centre leave the last molars obliquely and see only their inner halves: the curve
  // is fitted without the last sectors and goes straight on to the end of the crowns.
  const auto cut = static_cast<std::ptrdiff_t>(std::min<std::size_t>(4, phi.size() / 8));
  auto trimmed = [&](const std::vector<double>& v) {
    return std::vector<double>(v.begin() + cut, v.end() - cut);
  };
  const auto phi_in = trimmed(phi);
  const Eigen::VectorXd c = fit_radius(phi_in, trimmed(r), trimmed(weight), 6);
  std::vector<Eigen::Vector2d> line;
  for (int i = 0; i <= 400; ++i) {
    const double a = phi_in.front() + (phi_in.back() - phi_in.front()) * i / 400.0;
    double value = 0.0;
    for (Eigen::Index d = c.size() - 1; d >= 0; --d) value = value * a + c(d);
    line.push_back(centre + value * Eigen::Vector2d(std::sin(a), -std::cos(a)));
  }
  extend_to_crowns(points, line);
  std::reverse(line.begin(), line.end());
  extend_to_crowns(points, line);
  std::reverse(line.begin(), line.end());
  return resampled(line, step_mm);
}

std::vector<double> outer_radii(const std::vector<Eigen::Vector2d>& points, const Eigen::Vector2d& centre) {
  auto radii = radii_by_sector(points, centre, 90);
  std::vector<double> outer;
  for (auto& r : radii)
    outer.push_back(r.size() < 6 ? std::numeric_limits<double>::quiet_NaN() : percentile(r, 0.95));
  return outer;
}

}  // namespace gnathion
