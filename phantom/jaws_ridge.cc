#include "phantom/jaws_ridge.h"

#include <algorithm>
#include <cmath>

#include "core/mesh.h"

namespace gnathion {
namespace {

constexpr double kTableStepMm = 1.0;
constexpr double kBehindMm = 14.0;  ///< how far the ridge goes on behind the last molar

double catmull(double p0, double p1, double p2, double p3, double f) {
  return p1 + 0.5 * f * (p2 - p0 + f * (2 * p0 - 5 * p1 + 4 * p2 - p3 + f * (3 * (p1 - p2) + p3 - p0)));
}

}  // namespace

AlveolarRidge::AlveolarRidge(const DentalArch& arch) : apical_(arch.upper ? 1.0 : -1.0) {
  run_through(control_stations(arch));
  smooth();
  measure(arch);
  fill_table();
}

// The teeth at their necks, and the ridge going on behind the last ones.
std::vector<AlveolarRidge::Station> AlveolarRidge::control_stations(const DentalArch& arch) const {
  std::vector<Station> control;
  for (const PlacedTooth& t : arch.teeth) {
    const ToothForm& f = t.crown.form();
    Station c;
    const Vector3 p = t.to_jaw({0.0, 0.5 * (f.buccal_mm[0] + f.lingual_mm[0]), 0.0});
    c.point_mm = p.head<2>();
    c.margin_mm = apical_ * p.z() - 0.6;
    c.half_mm = 0.5 * (f.buccal_mm[0] - f.lingual_mm[0]);
    const Eigen::Vector2d out = t.jaw_from_tooth.col(1).head<2>().normalized();
    const Eigen::Vector2d w = t.jaw_from_tooth.col(2).head<2>();
    c.lean = -0.55 * out.dot(w) / std::abs(t.jaw_from_tooth(2, 2));
    control.push_back(c);
  }
  for (int end = 0; end < 2; ++end) {
    const Station last = control.back(), before = control[control.size() - 2];
    const Eigen::Vector2d along = (last.point_mm - before.point_mm).normalized();
    for (const double part : {0.5, 1.0, 1.5}) {
      Station c = last;
      c.point_mm += part * kBehindMm * along;
      c.half_mm *= 0.85;
      c.toothless = 1.0;
      control.push_back(c);
    }
    std::reverse(control.begin(), control.end());
  }
  return control;
}

void AlveolarRidge::run_through(const std::vector<Station>& control) {
  const int n = static_cast<int>(control.size());
  for (int i = 1; i + 2 < n; ++i) {
    const Station &a = control[i - 1], &b = control[i], &c = control[i + 1], &d = control[i + 2];
    const int steps = std::max(4, static_cast<int>((c.point_mm - b.point_mm).norm() / 0.4));
    for (int k = 0; k < steps; ++k) {
      const double f = static_cast<double>(k) / steps;
      Station s;
      for (int x = 0; x < 2; ++x) {
        s.point_mm[x] = catmull(a.point_mm[x], b.point_mm[x], c.point_mm[x], d.point_mm[x], f);
      }
      for (auto member : {&Station::margin_mm, &Station::half_mm, &Station::lean, &Station::toothless}) {
        s.*member = catmull(a.*member, b.*member, c.*member, d.*member, f);
      }
      if (b.toothless == 0.0 && c.toothless == 0.0) s.eminence = 0.5 + 0.5 * std::cos(2.0 * M_PI * f);
      s.rim_mm = s.margin_mm;
      stations_.push_back(s);
    }
  }
}

// Takes the teeth's own small offsets out of the ridge's run.
void AlveolarRidge::smooth() {
  const auto even_out = [&](double Station::*member, int rounds) {
    for (int round = 0; round < rounds; ++round) {
      double before = stations_[0].*member;
      for (std::size_t i = 1; i + 1 < stations_.size(); ++i) {
        const double here = stations_[i].*member;
        stations_[i].*member = 0.25 * before + 0.5 * here + 0.25 * stations_[i + 1].*member;
        before = here;
      }
    }
  };
  for (auto member : {&Station::margin_mm, &Station::half_mm, &Station::lean, &Station::toothless})
    even_out(member, 60);
  even_out(&Station::rim_mm, 600);
  even_out(&Station::eminence, 8);
  for (int round = 0; round < 60; ++round) {
    Eigen::Vector2d before = stations_[0].point_mm;
    for (std::size_t i = 1; i + 1 < stations_.size(); ++i) {
      const Eigen::Vector2d here = stations_[i].point_mm;
      stations_[i].point_mm = 0.25 * before + 0.5 * here + 0.25 * stations_[i + 1].point_mm;
      before = here;
    }
  }
}

void AlveolarRidge::measure(const DentalArch& arch) {
  double length = 0.0;
  for (std::size_t i = 0; i < stations_.size(); ++i) {
    // The stations run from the right to the left: outward lies to the right of their way.
    const Eigen::Vector2d a = stations_[i > 2 ? i - 3 : 0].point_mm;
    const Eigen::Vector2d b = stations_[std::min(i + 3, stations_.size() - 1)].point_mm;
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
  end_y_mm_ = distal + 4.5;
}

void AlveolarRidge::fill_table() {
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

std::size_t AlveolarRidge::nearest(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d q = (p - table_origin_) / kTableStepMm;
  const int x = std::clamp(static_cast<int>(q.x() + 0.5), 0, table_nx_ - 1);
  const int y = std::clamp(static_cast<int>(q.y() + 0.5), 0, table_ny_ - 1);
  std::size_t i = table_[static_cast<std::size_t>(y) * table_nx_ + x];
  const auto d = [&](std::size_t k) { return (stations_[k].point_mm - p).squaredNorm(); };
  while (i + 1 < stations_.size() && d(i + 1) < d(i)) ++i;
  while (i > 0 && d(i - 1) < d(i)) --i;
  return std::clamp<std::size_t>(i, 1, stations_.size() - 2);
}

AlveolarRidge::Local AlveolarRidge::local(const Vector3& p_mm) const {
  const Eigen::Vector2d p = p_mm.head<2>();
  std::size_t i = nearest(p);
  // The foot lies where the interpolated normal meets the point: continuous from station to station.
  const auto along = [&](std::size_t k) {
    const Station& s = stations_[k];
    return (p - s.point_mm).dot(Eigen::Vector2d(-s.outward.y(), s.outward.x()));
  };
  double here = along(i);
  if (here < 0.0 && i > 0) here = along(--i);
  const double next = along(i + 1);
  const double t = here > next ? std::clamp(here / (here - next), 0.0, 1.0) : 0.5;
  const Station &a = stations_[i], &b = stations_[i + 1];
  Local l;
  l.at.point_mm = a.point_mm + t * (b.point_mm - a.point_mm);
  l.at.outward = (a.outward + t * (b.outward - a.outward)).normalized();
  for (auto member : {&Station::s_mm, &Station::margin_mm, &Station::half_mm, &Station::lean,
                      &Station::eminence, &Station::rim_mm, &Station::toothless}) {
    l.at.*member = a.*member + t * (b.*member - a.*member);
  }
  l.across_mm = (p - l.at.point_mm).dot(l.at.outward);
  l.depth_mm = apical_ * p_mm.z() - l.at.margin_mm;
  return l;
}

}  // namespace gnathion
