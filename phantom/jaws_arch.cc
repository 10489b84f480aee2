#include "phantom/jaws_arch.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"

namespace gnathion {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr double kContactOverlapMm = 0.05;  ///< neighbours are pressed together by this much

/// Rounding in the crevice between two neighbours: what is narrower than half of it, no scanner resolves.
constexpr double kCreviceBlendMm = 0.45, kCreviceBlendBackMm = 0.65;

/// Inclination of a crown: its occlusal end outward (torque) and mesially (tip), degrees, numbers 1..7.
/// After Andrews' keys, told for the crown's axis instead of its facial face.
constexpr double kUpperTorqueDeg[8] = {0, 19, 18, 9, 2, 2, 4, 5};
constexpr double kUpperTipDeg[8] = {0, 3, 6, 7, 3, 2, 3, -2};
constexpr double kLowerTorqueDeg[8] = {0, 15, 14, 6, -3, -7, -11, -13};
constexpr double kLowerTipDeg[8] = {0, 1, 1, 4, 3, 3, 4, 7};

/// The curve of the lower incisal edges and buccal cusps, by arc length from the midline (left positive).
/// After Braun's beta function (Angle Orthod. 1998;68:29) with a rounder exponent; straight beyond its end.
class CuspCurve {
 public:
  explicit CuspCurve(const ArchPlan& plan) : plan_(plan) {
    const double w = plan.width_mm;
    Eigen::Vector2d last = {0.0, 0.0};
    double length = 0.0;
    points_.push_back(last);
    lengths_.push_back(0.0);
    for (int i = 1; i <= 400; ++i) {
      const double x = 0.5 * w * 0.975 * std::sin(0.5 * M_PI * i / 400.0);
      const double y = plan.depth_mm * (1.0 - std::pow(1.0 - 4.0 * x * x / (w * w), 0.68));
      const Eigen::Vector2d p = {x, y};
      length += (p - last).norm();
      points_.push_back(p);
      lengths_.push_back(length);
      last = p;
    }
    const Eigen::Vector2d end = (points_[400] - points_[396]).normalized();
    points_.push_back(last + 40.0 * end);
    lengths_.push_back(length + 40.0);
  }

  struct Place {
    Vector3 point_mm, mesial, outward;  // for the left side; horizontal axes
  };
  Place at(double s) const {
    const double side = s < 0 ? -1.0 : 1.0;
    const Eigen::Vector2d a = plan_point(std::abs(s) - 0.7), b = plan_point(std::abs(s) + 0.7);
    const Eigen::Vector2d p = plan_point(std::abs(s));
    const Eigen::Vector2d along = (b - a).normalized();
    const double x = p.x() * (1.0 + side * plan_.lateral_skew);
    const double z = x * x / (2.0 * plan_.wilson_radius_mm) + spee(p.y());
    return {{side * x, p.y(), z}, {-side * along.x(), -along.y(), 0.0}, {side * along.y(), -along.x(), 0.0}};
  }

 private:
  Eigen::Vector2d plan_point(double s) const {
    const bool mirrored = s < 0;
    s = std::abs(s);
    auto it = std::upper_bound(lengths_.begin(), lengths_.end(), s);
    const auto i = std::clamp<std::ptrdiff_t>(it - lengths_.begin(), 1, std::ptrdiff_t(lengths_.size()) - 1);
    const double t = (s - lengths_[i - 1]) / (lengths_[i] - lengths_[i - 1]);
    Eigen::Vector2d p = points_[i - 1] + t * (points_[i] - points_[i - 1]);
    if (mirrored) p.x() = -p.x();
    return p;
  }
  double spee(double y) const {
    constexpr double kDeepestMm = 21.0;
    return ((y - kDeepestMm) * (y - kDeepestMm) - kDeepestMm * kDeepestMm) / (2.0 * plan_.spee_radius_mm);
  }

  ArchPlan plan_;
  std::vector<Eigen::Vector2d> points_;
  std::vector<double> lengths_;
};

/// One tooth before it stands: what is its own.
struct ToothSeed {
  int fdi;
  ToothForm form;
  double rotation_deg, torque_deg, tip_deg;
  Vector3 unevenness_seed;
  Vector3 offset_mm;  ///< outward, along nothing, vertical
};

ToothSeed random_tooth(bool upper, int quadrant, int number, double jaw_size, Random& random) {
  ToothSeed seed;
  seed.fdi = 10 * quadrant + number;
  const double size = jaw_size * (1.0 + 0.01 * random.normal());
  const Vector3 factors(size * (1.0 + 0.006 * random.normal()), size * (1.0 + 0.015 * random.normal()),
                        1.0 + 0.02 * random.normal());
  seed.form = scaled(upper ? upper_tooth_form(number) : lower_tooth_form(number), factors);
  for (ReliefPoint& p : seed.form.points) {
    p.u_mm += 0.10 * random.normal();
    p.v_mm += 0.07 * random.normal();
    p.w_mm += 0.06 * random.normal();
  }
  const double unrest = number <= 2 && !upper ? 1.8 : 1.0;  // lower incisors are seldom straight
  seed.rotation_deg = 2.0 * unrest * random.normal();
  seed.torque_deg = (upper ? kUpperTorqueDeg : kLowerTorqueDeg)[number] + 1.0 * random.normal();
  seed.tip_deg = (upper ? kUpperTipDeg : kLowerTipDeg)[number] + 0.8 * random.normal();
  seed.unevenness_seed = 50.0 * random.normal3();
  seed.offset_mm = {0.12 * unrest * random.normal(), 0.0, (number <= 3 ? 0.12 : 0.03) * random.normal()};
  return seed;
}

PlacedTooth place(const ToothSeed& seed, bool upper, double s, const CuspCurve& curve, const ArchPlan& plan) {
  const CuspCurve::Place at = curve.at(s);
  const int number = seed.fdi % 10;
  const Vector3 up = upper ? Vector3(0, 0, -1) : Vector3(0, 0, 1);
  const Matrix3 turn = Rigid3::about_axis(Vector3::Zero(), up, seed.rotation_deg * kDegree).rotation;
  const Vector3 outward = turn * at.outward, mesial = turn * at.mesial;
  const Vector3 w =
      (up + std::tan(seed.torque_deg * kDegree) * outward + std::tan(seed.tip_deg * kDegree) * mesial)
          .normalized();
  const Vector3 u = (mesial - w * w.dot(mesial)).normalized();
  Vector3 v = outward - w * w.dot(outward);
  v = (v - u * u.dot(v)).normalized();

  Vector3 target = at.point_mm + seed.offset_mm.x() * at.outward + Vector3(0, 0, seed.offset_mm.z());
  if (upper && number <= 3) {
    // The upper front edges stand before and below the lower ones; the canine leads over to the molars.
    const double jet = number == 3 ? plan.overjet_mm + 0.35 : plan.overjet_mm;
    const double bite = number == 2 ? plan.overbite_mm - 0.5 : plan.overbite_mm + (number == 3 ? 0.1 : 0.0);
    target += jet * at.outward - Vector3(0, 0, bite);
  }
  if (upper && number == 7) target += 0.3 * at.outward;  // no end-to-end bite where the arch ends
  PlacedTooth tooth{seed.fdi, Crown(seed.form), Matrix3(), Vector3::Zero(), seed.unevenness_seed};
  tooth.jaw_from_tooth.col(0) = u;
  tooth.jaw_from_tooth.col(1) = v;
  tooth.jaw_from_tooth.col(2) = w;
  const ReliefPoint& r = seed.form.reference;
  tooth.origin_mm = target - tooth.jaw_from_tooth * Vector3(r.u_mm, r.v_mm, r.w_mm);
  return tooth;
}

/// Points of the mesial (+1) or distal (−1) half of the crown, tooth frame.
std::vector<Vector3> flank_points(const Crown& crown, double side) {
  std::vector<Vector3> points;
  const ToothForm& f = crown.form();
  for (int i = 0; i < 14; ++i) {
    const double w = f.height_mm * (0.3 + 0.68 * i / 13.0);
    for (int j = 0; j < 14; ++j) {
      const double v = f.lingual_mm[3] + (f.buccal_mm[2] - f.lingual_mm[3]) * (j + 0.5) / 14.0;
      double inside = 0.0, outside = 8.0;
      if (crown.distance_mm({0.0, v, w}) > 0.0) continue;
      for (int k = 0; k < 12; ++k) {
        const double middle = 0.5 * (inside + outside);
        (crown.distance_mm({side * middle, v, w}) > 0.0 ? outside : inside) = middle;
      }
      points.emplace_back(side * inside, v, w);
    }
  }
  return points;
}

double gap_mm(const std::vector<Vector3>& jaw_points, const PlacedTooth& tooth) {
  double gap = 1e9;
  for (const Vector3& p : jaw_points) gap = std::min(gap, tooth.crown.distance_mm(tooth.to_tooth(p)));
  return gap;
}

/// Sets the teeth of one side from the midline backwards, each touching the one before.
std::vector<PlacedTooth> set_side(const std::vector<ToothSeed>& seeds, bool upper, double side,
                                  const CuspCurve& curve, const ArchPlan& plan) {
  std::vector<PlacedTooth> teeth;
  double before = 0.0;
  for (const ToothSeed& seed : seeds) {
    const Crown crown(seed.form);
    const std::vector<Vector3> mesial = flank_points(crown, 1.0);
    std::vector<Vector3> neighbour;
    if (!teeth.empty()) {
      for (const Vector3& p : flank_points(teeth.back().crown, -1.0))
        neighbour.push_back(teeth.back().to_jaw(p));
    }
    const auto gap = [&](double s) {
      const PlacedTooth tooth = place(seed, upper, side * s, curve, plan);
      if (!teeth.empty()) return gap_mm(neighbour, tooth);
      double nearest = 1e9;  // to the midline
      for (const Vector3& p : mesial) nearest = std::min(nearest, side * tooth.to_jaw(p).x());
      return 2.0 * nearest;
    };
    double low = before + (teeth.empty() ? 0.5 : 2.0), high = before + 15.0;
    for (int k = 0; k < 18; ++k) {
      const double middle = 0.5 * (low + high);
      (gap(middle) > -kContactOverlapMm ? high : low) = middle;
    }
    before = high;
    teeth.push_back(place(seed, upper, side * before, curve, plan));
  }
  return teeth;
}

/// How far, along the arch, the upper first molar's mesiobuccal cusp stands behind the buccal groove of the
/// lower one: 0 in class I.
double molar_relation_mm(const PlacedTooth& upper6, const PlacedTooth& lower6) {
  const ReliefPoint& cusp = upper6.crown.form().points[0];
  const ReliefPoint& groove = lower6.crown.form().points[1];
  const Vector3 a = upper6.to_jaw({cusp.u_mm, cusp.v_mm, cusp.w_mm});
  const Vector3 b = lower6.to_jaw({groove.u_mm, groove.v_mm, groove.w_mm});
  return -(a - b).dot(lower6.jaw_from_tooth.col(0));
}

}  // namespace

ArchPlan random_arch_plan(Random& random) {
  ArchPlan plan;
  plan.width_mm += 1.6 * random.normal();
  plan.depth_mm += 1.2 * random.normal();
  plan.overjet_mm += 0.2 * std::clamp(random.normal(), -1.5, 1.5);
  plan.overbite_mm += 0.25 * std::clamp(random.normal(), -1.5, 1.5);
  plan.spee_radius_mm *= 1.0 + 0.1 * std::clamp(random.normal(), -1.5, 1.5);
  plan.lateral_skew = 0.008 * random.normal();
  return plan;
}

DentalArches lay_out_arches(const ArchPlan& plan, Random& random) {
  const CuspCurve curve(plan);
  const double jaw_size = 1.0 + 0.015 * random.normal();
  DentalArches arches;
  arches.upper.upper = true;
  for (const double side : {-1.0, 1.0}) {
    std::vector<ToothSeed> uppers, lowers;
    for (int n = 1; n <= 7; ++n) {
      uppers.push_back(random_tooth(true, side > 0 ? 2 : 1, n, jaw_size, random));
      lowers.push_back(random_tooth(false, side > 0 ? 3 : 4, n, jaw_size, random));
    }
    const std::vector<PlacedTooth> upper = set_side(uppers, true, side, curve, plan);
    std::vector<PlacedTooth> lower = set_side(lowers, false, side, curve, plan);
    // Bolton: the lower front teeth and premolars are as wide as class I of the molars asks for.
    for (int round = 0; round < 3; ++round) {
      const double behind = molar_relation_mm(upper[5], lower[5]);
      double width = 0.0;
      for (int n = 0; n < 5; ++n) width += lowers[n].form.mesial_mm[4] + lowers[n].form.distal_mm[4];
      const double factor = std::clamp(1.0 + behind / width, 0.93, 1.07);
      for (int n = 0; n < 5; ++n) lowers[n].form = scaled(lowers[n].form, {factor, 1.0, 1.0});
      lower = set_side(lowers, false, side, curve, plan);
    }
    for (const std::vector<PlacedTooth>* pair :
         {&upper, static_cast<const std::vector<PlacedTooth>*>(&lower)}) {
      DentalArch& arch = pair == &upper ? arches.upper : arches.lower;
      if (side < 0) {
        arch.teeth.assign(pair->rbegin(), pair->rend());
      } else {
        arch.teeth.insert(arch.teeth.end(), pair->begin(), pair->end());
      }
    }
  }
  return arches;
}

double PlacedTooth::distance_mm(const Vector3& p) const {
  const Vector3 q = to_tooth(p);
  const double d = crown.distance_mm(q);
  if (std::abs(d) > 1.5) return d;
  return d + 0.022 * smooth_noise(q / 2.3 + unevenness_seed);
}

double DentalArch::crowns_mm(const Vector3& p) const {
  double nearest = 1e9;
  for (const PlacedTooth& t : teeth) {
    const double bound = (p - t.centre_mm()).norm() - t.radius_mm();
    if (bound > 1.5) {
      nearest = std::min(nearest, bound);
    } else {
      nearest = smooth_min(nearest, t.distance_mm(p), t.posterior() ? kCreviceBlendBackMm : kCreviceBlendMm);
    }
  }
  return nearest;
}

Vector3 contact_point_mm(const PlacedTooth& a, const PlacedTooth& b) {
  const double side = (b.origin_mm - a.origin_mm).dot(a.jaw_from_tooth.col(0)) > 0 ? 1.0 : -1.0;
  double least = 1e9;
  Vector3 contact = Vector3::Zero();
  for (const Vector3& p : flank_points(a.crown, side)) {
    const Vector3 q = a.to_jaw(p);
    const double gap = b.crown.distance_mm(b.to_tooth(q));
    if (gap >= least) continue;
    least = gap;
    contact = q;
  }
  return contact;
}

PlacedTooth& DentalArch::tooth(int fdi) {
  for (PlacedTooth& t : teeth) {
    if (t.fdi == fdi) return t;
  }
  GNATHION_CHECK(false && "no such tooth");
}
const PlacedTooth& DentalArch::tooth(int fdi) const {
  return const_cast<DentalArch*>(this)->tooth(fdi);
}

double smooth_noise(const Vector3& p) {
  const auto lattice = [](std::int64_t x, std::int64_t y, std::int64_t z) {
    std::uint64_t h = static_cast<std::uint64_t>(x) * 0x9E3779B97F4A7C15ull ^
                      static_cast<std::uint64_t>(y) * 0xC2B2AE3D27D4EB4Full ^
                      static_cast<std::uint64_t>(z) * 0x165667B19E3779F9ull;
    h ^= h >> 29;
    h *= 0xBF58476D1CE4E5B9ull;
    h ^= h >> 32;
    return static_cast<double>(h & 0xFFFF) / 32767.5 - 1.0;
  };
  const Vector3 f = p.array().floor();
  const Vector3 t = p - f;
  const Vector3 s = t.array() * t.array() * t.array() * (t.array() * (t.array() * 6.0 - 15.0) + 10.0);
  const auto x = static_cast<std::int64_t>(f.x()), y = static_cast<std::int64_t>(f.y()),
             z = static_cast<std::int64_t>(f.z());
  double sum = 0.0;
  for (int i = 0; i < 8; ++i) {
    const double wx = i & 1 ? s.x() : 1 - s.x(), wy = i & 2 ? s.y() : 1 - s.y(),
                 wz = i & 4 ? s.z() : 1 - s.z();
    sum += wx * wy * wz * lattice(x + (i & 1), y + ((i >> 1) & 1), z + ((i >> 2) & 1));
  }
  return sum;
}

}  // namespace gnathion
