#include "phantom/tooth.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace gnathion {
namespace {

// Uniform Catmull-Rom through the knots; straight on beyond both ends.
double profile_at(const CrownProfile& p, double t) {
  const int last = static_cast<int>(p.size()) - 1;
  const double x = t * last;
  if (x <= 0.0) return p[0] + (p[1] - p[0]) * std::max(x, -1.0) * 0.5;
  if (x >= last) return p[last] + (p[last] - p[last - 1]) * std::min(x - last, 1.5);
  const int i = static_cast<int>(x);
  const double f = x - i;
  const double p1 = p[i], p2 = p[i + 1];
  const double p0 = i > 0 ? p[i - 1] : 2 * p1 - p2;
  const double p3 = i + 2 <= last ? p[i + 2] : 2 * p2 - p1;
  return p1 + 0.5 * f * (p2 - p0 + f * (2 * p0 - 5 * p1 + 4 * p2 - p3 + f * (3 * (p1 - p2) + p3 - p0)));
}

double smooth_step(double a, double b, double x) {
  const double t = std::clamp((x - a) / (b - a), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

// A window that is 1 in the middle of [a, b] and falls smoothly to 0 at its ends.
double window(double a, double b, double x) {
  if (x <= a || x >= b) return 0.0;
  const double s = (2.0 * x - a - b) / (b - a);
  const double q = 1.0 - s * s;
  return q * q * (3.0 - 2.0 * q) * 0.5 + q * 0.5;
}

double distance_to_segment(double u, double v, double au, double av, double bu, double bv, double* t) {
  const double du = bu - au, dv = bv - av;
  const double l2 = std::max(du * du + dv * dv, 1e-9);
  *t = std::clamp(((u - au) * du + (v - av) * dv) / l2, 0.0, 1.0);
  const double x = u - au - *t * du, y = v - av - *t * dv;
  return std::sqrt(x * x + y * y);
}

}  // namespace

Crown::Crown(ToothForm form) : form_(std::move(form)) {
  double reach = 0.0;
  for (const CrownProfile* p : {&form_.mesial_mm, &form_.distal_mm, &form_.buccal_mm, &form_.lingual_mm}) {
    for (const double x : *p) reach = std::max(reach, std::abs(x));
  }
  reach_mm_ = 1.25 * reach;
  radius_mm_ = std::hypot(1.25 * reach, 0.5 * form_.height_mm + 0.8);
}

double Crown::lingual_face_mm(double u, double t) const {
  double face = profile_at(form_.lingual_mm, t);
  if (form_.fossa_depth_mm > 0.0) {
    const double s = u / form_.fossa_half_width_mm;
    const double across = s * s < 1.0 ? (1.0 - s * s) * (1.0 - s * s) : 0.0;
    const double along = window(form_.fossa_from, form_.fossa_to, t);
    face += form_.fossa_depth_mm * across * along;
    face -= form_.lingual_ridge_mm * std::exp(-u * u / 0.6) * along;
  }
  return face;
}

double Crown::body_distance_mm(const Vector3& p) const {
  const double u = p.x(), t = p.z() / form_.height_mm;
  const double m = profile_at(form_.mesial_mm, t), d = profile_at(form_.distal_mm, t);
  const double buccal = profile_at(form_.buccal_mm, t);
  const double lingual = lingual_face_mm(u, t);
  const double v = p.y() + form_.bend_per_mm * u * u * smooth_step(-0.2, 0.5, t);
  const double half = std::max(0.5 * (buccal - lingual), 0.12);
  const double cv = (v - 0.5 * (buccal + lingual)) / half;
  const double width =
      std::max(0.5 * (m + d), 0.3) * (1.0 - form_.lingual_taper * 0.5 * (0.3 - std::clamp(cv, -1.3, 1.3)));
  const double cu = (u + form_.skew * p.y() - 0.5 * (m - d)) / width;
  const double n =
      form_.squareness_cervix + (form_.squareness_top - form_.squareness_cervix) * smooth_step(0.1, 0.8, t);
  const double au = std::abs(cu), av = std::abs(cv);
  const double big = std::max(au, av);
  if (big < 1e-6) return -std::min(width, half);
  // First-order distance (g − 1)/|∇g| of the superellipse g = (auⁿ + avⁿ)^(1/n), with two powers only.
  const double small = std::min(au, av) / big;
  const double power = small > 1e-9 ? std::pow(small, n) : 0.0;
  const double root = std::pow(1.0 + power, 1.0 / n);
  const double g_big = root / (1.0 + power), g_small = small > 1e-9 ? g_big * power / small : 0.0;
  const double gu = (au >= av ? g_big : g_small) / width, gv = (au >= av ? g_small : g_big) / half;
  double distance = (big * root - 1.0) / std::sqrt(gu * gu + gv * gv);
  for (const FaceGroove& groove : form_.face_grooves) {
    if ((cv > 0.0) != groove.buccal) continue;
    const double s = (u - groove.u_mm) / groove.width_mm;
    if (s * s > 6.0) continue;
    distance += groove.depth_mm * std::exp(-s * s) * window(groove.from, 2.0 * groove.to - groove.from, t) *
                smooth_step(0.2, 0.7, av);
  }
  return distance;
}

double Crown::edge_mm(double u) const {
  const double x = u - form_.edge_tip_u_mm;
  const double r = form_.edge_tip_round_mm;
  const double run = std::sqrt(x * x + r * r) - r;
  double w = form_.height_mm - (x > 0 ? form_.edge_mesial_slope : form_.edge_distal_slope) * run;
  const double m = profile_at(form_.mesial_mm, 0.9), d = profile_at(form_.distal_mm, 0.9);
  const double corner = x > 0 ? std::max(0.0, u / m - 0.45) / 0.55 : std::max(0.0, -u / d - 0.35) / 0.65;
  w -= (x > 0 ? form_.corner_mesial_mm : form_.corner_distal_mm) * corner * corner * corner;
  if (form_.mamelon_mm > 0.0) w += form_.mamelon_mm * std::cos(u * 6.0 * M_PI / (m + d));
  return w;
}

double Crown::relief_mm(double u, double v) const {
  if (form_.points.empty()) return edge_mm(u);
  double w = form_.floor_mm;
  for (const ReliefRidge& ridge : form_.ridges) {
    const ReliefPoint& a = form_.points[ridge.from];
    const ReliefPoint& b = form_.points[ridge.to];
    double t = 0.0;
    const double d = distance_to_segment(u, v, a.u_mm, a.v_mm, b.u_mm, b.v_mm, &t);
    const double fall = ridge.slope * (std::sqrt(d * d + ridge.round_mm * ridge.round_mm) - ridge.round_mm);
    const double crest = a.w_mm + (b.w_mm - a.w_mm) * t + ridge.bulge_mm * 4.0 * t * (1.0 - t);
    w = smooth_max(w, crest - fall, form_.relief_round_mm);
  }
  for (const Fissure& fissure : form_.fissures) {
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i + 1 < fissure.path_mm.size(); ++i) {
      double t = 0.0;
      const auto& a = fissure.path_mm[i];
      const auto& b = fissure.path_mm[i + 1];
      nearest = std::min(nearest, distance_to_segment(u, v, a.x(), a.y(), b.x(), b.y(), &t));
    }
    // A V, rounded at the bottom and running out softly at its brinks.
    const double s = 1.0 - std::sqrt(nearest * nearest + 0.03) / fissure.width_mm;
    if (s > 0.0) w -= fissure.depth_mm * s * s * (1.6 - 0.6 * s);
  }
  return w;
}

double Crown::distance_mm(const Vector3& p) const {
  const double body = body_distance_mm(p);
  if (body > 1.5) return body;  // the relief can only add to it
  // 1.15: the mean inclination of the relief, so that both parts weigh alike in the rounding.
  const double top = (p.z() - relief_mm(p.x(), p.y())) / 1.15;
  return smooth_max(body, top, form_.edge_round_mm);
}

double Crown::margin_mm(const Vector3& p) const {
  const double m = 0.5 * (form_.mesial_mm[1] + form_.distal_mm[1]);
  const double half = 0.5 * (form_.buccal_mm[1] - form_.lingual_mm[1]);
  const double u = p.x() / m;
  const double v = (p.y() - 0.5 * (form_.buccal_mm[1] + form_.lingual_mm[1])) / half;
  const double r2 = std::max(u * u + v * v, 1e-6);
  const double side = u * u / r2;  // 0 on the faces, 1 between the teeth
  const double face = v > 0 ? form_.margin_buccal_mm : form_.margin_lingual_mm;
  return face + (form_.papilla_mm - face) * side * (0.35 + 0.65 * side);
}

Vector3 Crown::surface_from_above_mm(double u, double v) const {
  double high = form_.height_mm + 1.5, low = 0.2 * form_.height_mm;
  if (distance_mm({u, v, low}) > 0.0) return {u, v, std::numeric_limits<double>::quiet_NaN()};
  // The first crossing from above: march, then bisect.
  const double step = 0.4;
  double w = high;
  while (w > low && distance_mm({u, v, w}) > 0.0) w -= step;
  high = w + step;
  low = w;
  for (int i = 0; i < 14; ++i) {
    const double middle = 0.5 * (low + high);
    (distance_mm({u, v, middle}) > 0.0 ? high : low) = middle;
  }
  return {u, v, 0.5 * (low + high)};
}

ToothForm scaled(const ToothForm& form, const Vector3& factors) {
  ToothForm f = form;
  const double su = factors.x(), sv = factors.y(), sw = factors.z();
  const auto scale = [](CrownProfile& p, double s) {
    for (double& x : p) x *= s;
  };
  f.height_mm *= sw;
  scale(f.mesial_mm, su);
  scale(f.distal_mm, su);
  scale(f.buccal_mm, sv);
  scale(f.lingual_mm, sv);
  f.edge_tip_u_mm *= su;
  f.fossa_half_width_mm *= su;
  for (ReliefPoint& p : f.points) p = {p.u_mm * su, p.v_mm * sv, p.w_mm + form.height_mm * (sw - 1.0)};
  for (Fissure& fissure : f.fissures) {
    for (auto& p : fissure.path_mm) p = {p.x() * su, p.y() * sv};
  }
  for (FaceGroove& g : f.face_grooves) g.u_mm *= su;
  f.floor_mm += form.height_mm * (sw - 1.0);
  f.reference = {f.reference.u_mm * su, f.reference.v_mm * sv,
                 f.reference.w_mm + form.height_mm * (sw - 1.0)};
  return f;
}

}  // namespace gnathion
