#include "phantom/jaws_gingiva.h"

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

constexpr double kTableStepMm = 1.0;
constexpr double kBehindMm = 14.0;  ///< how far the ridge goes on behind the last molar

double smooth_step(double a, double b, double x) {
  const double t = std::clamp((x - a) / (b - a), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

double catmull(double p0, double p1, double p2, double p3, double f) {
  return p1 + 0.5 * f * (p2 - p0 + f * (2 * p0 - 5 * p1 + 4 * p2 - p3 + f * (3 * (p1 - p2) + p3 - p0)));
}

}  // namespace

Gingiva::Gingiva(const DentalArch& arch, std::uint64_t seed)
    : arch_(&arch), apical_(arch.upper ? 1.0 : -1.0) {
  Random random(seed, arch.upper ? 71 : 72);
  unevenness_seed_ = 40.0 * random.normal3();
  vault_mm_ += 1.0 * random.normal();
  // Control points: the teeth at their cervix, and the ridge going on behind the last ones.
  std::vector<Station> control;
  for (const PlacedTooth& t : arch.teeth) {
    const ToothForm& f = t.crown.form();
    Station c;
    const double middle = 0.5 * (f.buccal_mm[0] + f.lingual_mm[0]);
    const Vector3 p = t.to_jaw({0.0, middle, 0.0});
    c.point_mm = p.head<2>();
    c.margin_mm = apical_ * p.z() - 0.6;
    c.half_mm = 0.5 * (f.buccal_mm[0] - f.lingual_mm[0]);
    const Eigen::Vector2d out = t.jaw_from_tooth.col(1).head<2>().normalized();
    const Eigen::Vector2d w = t.jaw_from_tooth.col(2).head<2>();
    c.lean = -0.55 * out.dot(w) / std::abs(t.jaw_from_tooth(2, 2));
    control.push_back(c);
  }
  const auto go_on = [&](const Station& last, const Station& before, double by) {
    Station c = last;
    c.point_mm = last.point_mm + by * (last.point_mm - before.point_mm).normalized();
    c.half_mm *= 0.8;
    return c;
  };
  for (int end = 0; end < 2; ++end) {
    const Station last = control.back(), before = control[control.size() - 2];
    control.push_back(go_on(last, before, 0.5 * kBehindMm));
    control.push_back(go_on(last, before, kBehindMm));
    control.push_back(go_on(last, before, 1.5 * kBehindMm));
    std::reverse(control.begin(), control.end());
  }
  const int n = static_cast<int>(control.size());
  for (int i = 1; i + 2 < n; ++i) {
    const int steps =
        std::max(4, static_cast<int>((control[i + 1].point_mm - control[i].point_mm).norm() / 0.4));
    for (int k = 0; k < steps; ++k) {
      const double f = static_cast<double>(k) / steps;
      const auto mix = [&](auto member) {
        return catmull(control[i - 1].*member, control[i].*member, control[i + 1].*member,
                       control[i + 2].*member, f);
      };
      Station s;
      for (int a = 0; a < 2; ++a) {
        s.point_mm[a] = catmull(control[i - 1].point_mm[a], control[i].point_mm[a],
                                control[i + 1].point_mm[a], control[i + 2].point_mm[a], f);
      }
      s.margin_mm = mix(&Station::margin_mm);
      s.half_mm = mix(&Station::half_mm);
      s.lean = mix(&Station::lean);
      const bool beside_teeth = i >= 3 && i + 1 <= n - 4;
      s.eminence = beside_teeth ? 0.5 + 0.5 * std::cos(2.0 * M_PI * f)
                                : 1.0 - std::min(1.0, std::abs(i < 3 ? 1 - f : f));
      stations_.push_back(s);
    }
  }
  // Two rounds of smoothing take the teeth's own small offsets out of the ridge's run.
  for (int round = 0; round < 40; ++round) {
    std::vector<Station> before = stations_;
    for (std::size_t i = 1; i + 1 < stations_.size(); ++i) {
      stations_[i].point_mm =
          0.25 * before[i - 1].point_mm + 0.5 * before[i].point_mm + 0.25 * before[i + 1].point_mm;
      stations_[i].half_mm =
          0.25 * before[i - 1].half_mm + 0.5 * before[i].half_mm + 0.25 * before[i + 1].half_mm;
      stations_[i].margin_mm =
          0.25 * before[i - 1].margin_mm + 0.5 * before[i].margin_mm + 0.25 * before[i + 1].margin_mm;
      stations_[i].lean = 0.25 * before[i - 1].lean + 0.5 * before[i].lean + 0.25 * before[i + 1].lean;
    }
  }
  // The stations run from right to left: outward is to their left... of the direction turned by −90°.
  double length = 0.0;
  for (std::size_t i = 0; i < stations_.size(); ++i) {
    const Eigen::Vector2d a = stations_[i > 0 ? i - 1 : 0].point_mm;
    const Eigen::Vector2d b = stations_[std::min(i + 1, stations_.size() - 1)].point_mm;
    const Eigen::Vector2d along = (b - a).normalized();
    stations_[i].outward = {along.y(), -along.x()};
    if (i > 0) length += (stations_[i].point_mm - stations_[i - 1].point_mm).norm();
    stations_[i].s_mm = length;
    mean_margin_mm_ += stations_[i].margin_mm / static_cast<double>(stations_.size());
  }
  double distal = -1e9;
  front_y_mm_ = 1e9;
  for (const PlacedTooth& t : arch.teeth) {
    distal = std::max(distal, t.to_jaw({-t.crown.form().distal_mm[4], 0.0, 4.0}).y());
    front_y_mm_ = std::min(front_y_mm_, t.origin_mm.y());
  }
  end_y_mm_ = distal + 4.0;
  fill_nearest_table();
}

void Gingiva::fill_nearest_table() {
  Box box;
  for (const Station& s : stations_) box.extend({s.point_mm.x(), s.point_mm.y(), 0.0});
  table_origin_ = box.min_mm.head<2>() - Eigen::Vector2d(15, 15);
  table_nx_ = static_cast<int>((box.size_mm().x() + 30.0) / kTableStepMm) + 2;
  table_ny_ = static_cast<int>((box.size_mm().y() + 30.0) / kTableStepMm) + 2;
  table_.resize(static_cast<std::size_t>(table_nx_) * table_ny_);
  for (int y = 0; y < table_ny_; ++y) {
    for (int x = 0; x < table_nx_; ++x) {
      const Eigen::Vector2d p = table_origin_ + kTableStepMm * Eigen::Vector2d(x, y);
      double best = 1e18;
      for (std::size_t i = 0; i < stations_.size(); ++i) {
        const double d = (stations_[i].point_mm - p).squaredNorm();
        if (d >= best) continue;
        best = d;
        table_[static_cast<std::size_t>(y) * table_nx_ + x] = static_cast<std::uint16_t>(i);
      }
    }
  }
}

std::size_t Gingiva::nearest_station(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d q = (p - table_origin_) / kTableStepMm;
  const int x = std::clamp(static_cast<int>(q.x() + 0.5), 0, table_nx_ - 1);
  const int y = std::clamp(static_cast<int>(q.y() + 0.5), 0, table_ny_ - 1);
  std::size_t i = table_[static_cast<std::size_t>(y) * table_nx_ + x];
  const auto d = [&](std::size_t k) { return (stations_[k].point_mm - p).squaredNorm(); };
  while (i + 1 < stations_.size() && d(i + 1) < d(i)) ++i;
  while (i > 0 && d(i - 1) < d(i)) --i;
  return i;
}

Gingiva::Local Gingiva::local(const Vector3& p_mm) const {
  const Eigen::Vector2d p = p_mm.head<2>();
  const std::size_t i = std::clamp<std::size_t>(nearest_station(p), 1, stations_.size() - 2);
  // On the polyline through the station: the foot, and everything interpolated there.
  const Eigen::Vector2d along(-stations_[i].outward.y(), stations_[i].outward.x());
  const double step = (p - stations_[i].point_mm).dot(along);
  const std::size_t j = step > 0 ? i + 1 : i - 1;
  const double t = std::min(1.0, std::abs(step) / std::abs(stations_[j].s_mm - stations_[i].s_mm));
  const Station &a = stations_[i], &b = stations_[j];
  Local l;
  l.at.point_mm = a.point_mm + t * (b.point_mm - a.point_mm);
  l.at.outward = (a.outward + t * (b.outward - a.outward)).normalized();
  l.at.margin_mm = a.margin_mm + t * (b.margin_mm - a.margin_mm);
  l.at.half_mm = a.half_mm + t * (b.half_mm - a.half_mm);
  l.at.lean = a.lean + t * (b.lean - a.lean);
  l.at.eminence = a.eminence + t * (b.eminence - a.eminence);
  l.across_mm = (p - l.at.point_mm).dot(l.at.outward);
  l.depth_mm = apical_ * p_mm.z() - l.at.margin_mm;
  return l;
}

double Gingiva::ridge_mm(const Local& l) const {
  const double t = std::max(l.depth_mm, -2.0);
  const double across = l.across_mm - l.at.lean * t;
  double half = l.at.half_mm + 0.1 + 1.3 * (1.0 - std::exp(-std::max(t, 0.0) / 3.5));
  if (across > 0.0)
    half += 0.35 * (l.at.eminence - 0.6) * smooth_step(0.5, 3.0, t) * (1.0 - smooth_step(5.0, 9.0, t));
  return smooth_max(std::abs(across) - half, 1.3 - l.depth_mm, 1.8);
}

double Gingiva::palate_mm(const Vector3& p, const Local& l) const {
  const double inward = -l.across_mm - l.at.half_mm;
  const double margin = l.at.margin_mm + (mean_margin_mm_ - l.at.margin_mm) * smooth_step(0.0, 9.0, inward);
  const double depth = apical_ * p.z() - margin;
  const double front = 1.0 - smooth_step(4.0, 22.0, p.y() - front_y_mm_);
  const double reach = 6.6 + 3.0 * front;
  const double x = std::max(inward + 0.5, 0.0) / reach;
  double vault = 0.8 + vault_mm_ * (1.0 - std::exp(-std::pow(x, 1.45)));
  if (inward < 0.0) vault += 1.2 * inward * inward;
  // Incisive papilla, median raphe and the palatal rugae.
  const double y = p.y() - front_y_mm_, ax = std::abs(p.x());
  vault -= 0.9 * std::exp(-(p.x() * p.x()) / 3.2 - (y - 7.2) * (y - 7.2) / 5.5);
  vault -= 0.25 * std::exp(-p.x() * p.x() / 0.8) * smooth_step(8.0, 14.0, y);
  for (int k = 0; k < 4; ++k) {
    const double side = p.x() > 0 ? 1.0 : -1.0;
    const double wave = 0.7 * smooth_noise(Vector3(ax / 2.6, side * 3.0 + k * 5.0, 0.5) + unevenness_seed_);
    const double line = 9.3 + 3.3 * k + 0.16 * ax + wave + (0.012 * k - 0.01) * ax * ax;
    const double d = (y - line) / 0.75;
    const double length = smooth_step(0.7, 2.2, ax) * (1.0 - smooth_step(9.0 - 0.9 * k, 12.0 - 1.1 * k, ax));
    vault -= (0.75 - 0.09 * k) * std::exp(-d * d) * length * smooth_step(1.5, 4.5, inward);
  }
  return (vault - depth) / 1.4;
}

double Gingiva::collars_mm(const Vector3& p) const {
  double collar = 1e9;
  for (const PlacedTooth& t : arch_->teeth) {
    const Vector3 q = t.to_tooth(p);
    if (q.head<2>().squaredNorm() > 81.0) continue;
    const double x = t.crown.margin_mm(q) - q.z();  // depth under the margin
    if (x < -3.0) continue;
    const double thickness = x > 0.0 ? 0.5 * (1.0 - std::exp(-x / 0.4)) + 0.06 * std::min(x, 5.0) : 1.3 * x;
    collar = smooth_min(collar, (t.crown.body_distance_mm(q) - thickness) / 1.2, 0.8);
  }
  return collar;
}

double Gingiva::distance_mm(const Vector3& p) const {
  const Local l = local(p);
  double d = smooth_min(ridge_mm(l), collars_mm(p), 1.6);
  if (arch_->upper) d = smooth_min(d, palate_mm(p, l), 2.5);
  if (std::abs(d) < 1.0) {
    d += 0.05 * smooth_noise(p / 2.1 + unevenness_seed_) + 0.07 * smooth_noise(p / 4.7 - unevenness_seed_);
  }
  return d;
}

double Gingiva::beyond_rim_mm(const Vector3& p) const {
  const Local l = local(p);
  double beyond = l.depth_mm - kRimDepthMm;
  if (arch_->upper) beyond = std::min(beyond, l.across_mm + 1.0);
  return std::max(beyond, p.y() - end_y_mm_);
}

Box Gingiva::box_mm() const {
  Box box;
  double lowest = 1e9, highest = -1e9, occlusal = 1e9;
  for (const Station& s : stations_) {
    if (s.point_mm.y() > end_y_mm_ + 3.0) continue;
    const Eigen::Vector2d outer = s.point_mm + 11.0 * s.outward;
    box.extend({outer.x(), outer.y(), 0.0});
    box.extend({s.point_mm.x(), s.point_mm.y(), 0.0});
    lowest = std::min(lowest, s.margin_mm);
    highest = std::max(highest, s.margin_mm);
  }
  for (const PlacedTooth& t : arch_->teeth) {
    occlusal = std::min(occlusal, apical_ * t.to_jaw({0, 0, t.crown.form().height_mm + 1.8}).z() - 1.5);
  }
  const double apical_end =
      std::max(highest + kRimDepthMm, arch_->upper ? mean_margin_mm_ + vault_mm_ + 2.0 : 0.0) + 1.5;
  box.min_mm.z() = arch_->upper ? occlusal : -apical_end;
  box.max_mm.z() = arch_->upper ? apical_end : -occlusal;
  box.max_mm.y() = end_y_mm_ + 1.5;
  return box;
}

}  // namespace gnathion
