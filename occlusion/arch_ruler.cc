#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "occlusion/arch.h"

namespace gnathion {
namespace {

/// Parameter of the point of segment a..b nearest to p, unclamped.
double along_segment(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& p) {
  const Eigen::Vector2d d = b - a;
  return d.dot(p - a) / std::max(1e-12, d.squaredNorm());
}

}  // namespace

ArchRuler::ArchRuler(const ArchFrame& frame) : frame_(frame) {
  GNATHION_CHECK(frame.curve_mm.size() >= 2);
  for (const auto& p : frame.curve_mm) {
    const Vector3 q = frame.to_arch(p);
    points_.emplace_back(q.x(), q.y());
  }
  s_.assign(points_.size(), 0.0);
  for (std::size_t i = 1; i < s_.size(); ++i) s_[i] = s_[i - 1] + (points_[i] - points_[i - 1]).norm();
  // Zero at the midline: where the curve passes x = 0, at the front.
  double midline = 0.5 * s_.back();
  double front_y = 1e300;
  for (std::size_t i = 1; i < points_.size(); ++i) {
    const double x0 = points_[i - 1].x(), x1 = points_[i].x();
    if (!(x0 <= 0.0 && x1 > 0.0)) continue;
    const double f = -x0 / (x1 - x0);
    const double y = points_[i - 1].y() + f * (points_[i].y() - points_[i - 1].y());
    if (y >= front_y) continue;
    front_y = y;
    midline = s_[i - 1] + f * (s_[i] - s_[i - 1]);
  }
  for (double& s : s_) s -= midline;
  constexpr std::size_t kSegments = 12;
  const std::size_t last = points_.size() - 2;  // the first and the last segment go on for ever
  for (std::size_t first = 1; first < last; first += kSegments) {
    Stretch part{first, std::min(first + kSegments, last)};
    part.centre = 0.5 * (points_[part.first] + points_[part.end]);
    for (std::size_t i = part.first; i <= part.end; ++i)
      part.radius_mm = std::max(part.radius_mm, (points_[i] - part.centre).norm());
    stretches_.push_back(part);
  }
}

ArchCoordinates ArchRuler::measure(const Vector3& p_mm) const {
  const Vector3 q3 = frame_.to_arch(p_mm);
  const Eigen::Vector2d q(q3.x(), q3.y());
  ArchCoordinates best;
  double best_distance = 1e300;
  std::size_t best_segment = points_.size();
  const auto ask = [&](std::size_t i) {
    double f = along_segment(points_[i], points_[i + 1], q);
    // Beyond its ends the curve goes on along its tangents.
    if (i > 0) f = std::max(f, 0.0);
    if (i + 2 < points_.size()) f = std::min(f, 1.0);
    const Eigen::Vector2d d = points_[i + 1] - points_[i], foot = points_[i] + f * d;
    const double distance = (q - foot).squaredNorm();
    if (distance > best_distance || (distance == best_distance && i >= best_segment)) return;
    best_distance = distance;
    best_segment = i;
    best.s_mm = s_[i] + f * (s_[i + 1] - s_[i]);
    // Going from right (−x) over the front (−y) to the left, the outside is on the right hand: (d.y, −d.x).
    best.buccal_mm = std::copysign(std::sqrt(distance), d.y() * (q - foot).x() - d.x() * (q - foot).y());
  };
  // The nearest stretch first, so that most others are too far off. Of equals the first segment is taken,
  // whatever the order.
  ask(0);
  ask(points_.size() - 2);
  const Stretch* nearest = nullptr;
  double least = 1e300;
  for (const Stretch& part : stretches_)
    if (const double d = (q - part.centre).squaredNorm(); d < least) {
      least = d;
      nearest = &part;
    }
  const auto ask_all = [&](const Stretch& part) {
    for (std::size_t i = part.first; i < part.end; ++i) ask(i);
  };
  if (nearest) ask_all(*nearest);
  for (const Stretch& part : stretches_) {
    if (&part == nearest) continue;
    const double reach = part.radius_mm + std::sqrt(best_distance) + 1e-9;
    if ((q - part.centre).squaredNorm() <= reach * reach) ask_all(part);
  }
  best.height_mm = q3.z();
  return best;
}

Vector3 ArchRuler::at(double s_mm) const {
  const auto it = std::upper_bound(s_.begin() + 1, s_.end() - 1, s_mm);
  const auto i = static_cast<std::size_t>(it - s_.begin());
  const double f = (s_mm - s_[i - 1]) / std::max(1e-12, s_[i] - s_[i - 1]);
  const Eigen::Vector2d p = points_[i - 1] + f * (points_[i] - points_[i - 1]);
  return frame_.dental_from_arch() * Vector3(p.x(), p.y(), 0.0);
}

Vector3 ArchRuler::tangent(double s_mm) const {
  return (at(s_mm + 0.5) - at(s_mm - 0.5)).normalized();
}

Vector3 ArchRuler::outward(double s_mm) const {
  const Vector3 t = tangent(s_mm);
  return t.cross(frame_.up);
}

}  // namespace gnathion
