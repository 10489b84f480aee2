#include "phantom/jaws_palate.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/mesh.h"

namespace gnathion {
namespace {

constexpr double kNodeMm = 0.75;

double smooth_step(double a, double b, double x) {
  const double t = std::clamp((x - a) / (b - a), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

std::array<double, 4> b_spline(double f) {
  const double g = 1.0 - f;
  return {g * g * g / 6.0, (3 * f * f * f - 6 * f * f + 4) / 6.0, (3 * g * g * g - 6 * g * g + 4) / 6.0,
          f * f * f / 6.0};
}

}  // namespace

Palate::Palate(const AlveolarRidge& ridge, Random& random) : front_y_mm_(ridge.front_y_mm()) {
  const double rise = 12.5 + 1.0 * random.normal();
  rugae_seed_ = 40.0 * random.normal3();
  Box box;
  for (const auto& s : ridge.stations()) box.extend({s.point_mm.x(), s.point_mm.y(), 0.0});
  origin_ = box.min_mm.head<2>() - Eigen::Vector2d(13, 13);
  nx_ = static_cast<int>((box.size_mm().x() + 26.0) / kNodeMm) + 2;
  ny_ = static_cast<int>((box.size_mm().y() + 26.0) / kNodeMm) + 2;
  vault_.resize(static_cast<std::size_t>(nx_) * ny_);
  std::vector<double> softness(vault_.size());
  for (int y = 0; y < ny_; ++y) {
    for (int x = 0; x < nx_; ++x) {
      const Eigen::Vector2d p = origin_ + kNodeMm * Eigen::Vector2d(x, y);
      const AlveolarRidge::Local l = ridge.local({p.x(), p.y(), 0.0});
      const double inward = -l.across_mm - l.at.half_mm;
      const double margin =
          l.at.margin_mm + (ridge.mean_margin_mm() - l.at.margin_mm) * smooth_step(0.0, 9.0, inward);
      const double front = 1.0 - smooth_step(4.0, 24.0, p.y() - front_y_mm_);
      const double reach = 6.4 + 3.4 * front;
      const double t = std::max(inward + 0.5, 0.0) / reach;
      double height = margin + 0.8 + 2.4 * l.at.toothless + rise * (1.0 - std::exp(-std::pow(t, 1.45)));
      if (inward < 0.0) height += std::min(1.2 * inward * inward, 60.0);
      const std::size_t i = static_cast<std::size_t>(y) * nx_ + x;
      vault_[i] = height;
      softness[i] = smooth_step(2.5, 8.0, inward);
    }
  }
  // In the middle the nearest place of the ridge jumps from side to side: evened out.
  for (int round = 0; round < 60; ++round) {
    const std::vector<double> before = vault_;
    for (int y = 1; y + 1 < ny_; ++y) {
      for (int x = 1; x + 1 < nx_; ++x) {
        const std::size_t i = static_cast<std::size_t>(y) * nx_ + x;
        const double mean = 0.25 * (before[i - 1] + before[i + 1] + before[i - nx_] + before[i + nx_]);
        vault_[i] += 0.7 * softness[i] * (mean - before[i]);
      }
    }
  }
  for (std::size_t i = 0; i < vault_.size(); ++i) {
    if (softness[i] > 0.0) highest_mm_ = std::max(highest_mm_, vault_[i]);
  }
}

double Palate::vault_at(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d q = (p - origin_) / kNodeMm;
  const int x = std::clamp(static_cast<int>(q.x()), 1, nx_ - 3),
            y = std::clamp(static_cast<int>(q.y()), 1, ny_ - 3);
  const auto wx = b_spline(std::clamp(q.x() - x, 0.0, 1.0)), wy = b_spline(std::clamp(q.y() - y, 0.0, 1.0));
  double sum = 0.0;
  for (int j = 0; j < 4; ++j) {
    const double* row = &vault_[static_cast<std::size_t>(y + j - 1) * nx_ + (x - 1)];
    sum += wy[j] * (wx[0] * row[0] + wx[1] * row[1] + wx[2] * row[2] + wx[3] * row[3]);
  }
  return sum;
}

// How far the tissue stands out of the vault: incisive papilla, median raphe, and four pairs of rugae that
// run irregularly from beside the raphe outwards and back.
double Palate::relief_at(const Eigen::Vector2d& p) const {
  const double y = p.y() - front_y_mm_, ax = std::abs(p.x());
  double out = 1.0 * std::exp(-(p.x() * p.x()) / 3.2 - (y - 7.4) * (y - 7.4) / 6.0);
  out += 0.22 * std::exp(-p.x() * p.x() / 0.9) * smooth_step(9.0, 15.0, y);
  const double side = p.x() > 0 ? 11.0 : 0.0;
  for (int k = 0; k < 4; ++k) {
    const Vector3 own = rugae_seed_ + Vector3(0.0, side, 7.3 * k);
    const double wave = 0.75 * smooth_noise(Vector3(ax / 2.7, 0.5, 0.5) + own);
    const double line = 9.6 + 3.2 * k + 0.10 * ax + wave + 0.012 * (k - 1) * ax * ax;
    const double d = (y - line) / (0.8 + 0.15 * smooth_noise(Vector3(ax / 1.9, 3.5, 0.5) + own));
    const double reach = 10.0 - 1.3 * k + 1.5 * smooth_noise(own);
    const double length = smooth_step(0.6, 2.4, ax) * (1.0 - smooth_step(reach - 3.0, reach, ax));
    const double height = (0.7 - 0.09 * k) * (1.0 + 0.35 * smooth_noise(Vector3(ax / 2.2, 8.5, 0.5) + own));
    out += height * std::exp(-d * d) * length;
  }
  return out;
}

double Palate::distance_mm(const Vector3& p) const {
  const Eigen::Vector2d q = p.head<2>();
  const double above = vault_at(q) - p.z();
  if (std::abs(above) > 3.0) return above / 1.4;
  return (above - relief_at(q)) / 1.4;
}

}  // namespace gnathion
