#include "phantom/jaws_gingiva.h"

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

double smooth_step(double a, double b, double x) {
  const double t = std::clamp((x - a) / (b - a), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

}  // namespace

Gingiva::Gingiva(const DentalArch& arch, std::uint64_t seed) : arch_(&arch), ridge_(arch) {
  Random random(seed, arch.upper ? 71 : 72);
  unevenness_seed_ = 40.0 * random.normal3();
  if (arch.upper) palate_.emplace(ridge_, random);
  for (std::size_t i = 0; i + 1 < arch.teeth.size(); ++i) {
    const PlacedTooth &a = arch.teeth[i], &b = arch.teeth[i + 1];
    Papilla papilla;
    const bool front = a.number() <= 3 && b.number() <= 3;
    papilla.apical = -(a.jaw_from_tooth.col(2) + b.jaw_from_tooth.col(2)).normalized();
    papilla.widening = front ? 0.24 : 0.42;
    papilla.along = b.centre_mm() - a.centre_mm();
    papilla.along = (papilla.along - papilla.apical * papilla.apical.dot(papilla.along)).normalized();
    papilla.across = papilla.apical.cross(papilla.along);
    // The tip lies just under the contact, but no papilla covers more than half of a crown.
    const Vector3 contact = contact_point_mm(a, b);
    const auto height = [&](const PlacedTooth& t) {
      return t.to_tooth(contact).z() / t.crown.form().height_mm;
    };
    const double excess =
        std::max(0.0, 0.5 * (height(a) + height(b)) - (arch.upper ? 0.57 : 0.62)) * a.crown.form().height_mm;
    papilla.tip_mm = contact + std::max(front ? 0.9 : 0.6, excess) * papilla.apical;
    const auto half = [](const PlacedTooth& t) {
      return 0.5 * (t.crown.form().buccal_mm[1] - t.crown.form().lingual_mm[1]);
    };
    papilla.half_mm = std::min(half(a), half(b));
    papillae_.push_back(papilla);
  }
}

double Gingiva::ridge_mm(const AlveolarRidge::Local& l) const {
  const double t = std::max(l.depth_mm, -2.0);
  const double across = l.across_mm - l.at.lean * t;
  double half = l.at.half_mm + 0.15 + 1.3 * (1.0 - std::exp(-std::max(t, 0.0) / 3.5));
  if (across > 0.0) {
    half += 0.45 * (l.at.eminence - 0.6) * smooth_step(0.3, 2.5, t) * (1.0 - smooth_step(5.0, 10.0, t));
  }
  const double crest = 1.0 - 0.2 * l.at.toothless;
  return smooth_max(std::abs(across) - half, crest - l.depth_mm, 2.4 + 2.6 * l.at.toothless);
}

// The cuff about each neck: from nothing at the margin, rolled, to about 0.7 mm below it.
double Gingiva::collars_mm(const Vector3& p) const {
  double collar = 1e9;
  for (const PlacedTooth& t : arch_->teeth) {
    const Vector3 q = t.to_tooth(p);
    const double far = t.crown.reach_mm() + 2.5;
    if (q.head<2>().squaredNorm() > far * far) continue;
    const double x = t.crown.margin_mm(q) - q.z();  // depth under the margin
    if (x < -3.0) continue;
    const double thickness =
        x > 0.0 ? 0.5 * (1.0 - std::exp(-x / 0.4)) + 0.06 * std::min(x, 5.0) : 1.3 * x - x * x;
    collar = smooth_min(collar, (t.crown.body_distance_mm(q) - thickness) / 1.2, 0.8);
  }
  return collar;
}

double Gingiva::papillae_mm(const Vector3& p) const {
  double nearest = 1e9;
  for (const Papilla& w : papillae_) {
    const Vector3 d = p - w.tip_mm;
    if (d.squaredNorm() > 60.0) continue;
    const double down = d.dot(w.apical), deep = std::clamp(down, 0.0, 6.0);
    const double thick = 0.45 + 0.3 * deep - 0.06 * std::max(0.0, deep - 3.0) * (deep - 3.0);
    const double wide = (0.2 * w.half_mm + w.widening * deep) * thick / (0.45 + 0.3 * deep);
    const double g = std::hypot(d.dot(w.along) / thick, d.dot(w.across) / wide);
    nearest = smooth_min(nearest, smooth_max((g - 1.0) * thick, -down, 0.9), 0.3);
  }
  return nearest;
}

double Gingiva::distance_mm(const Vector3& p) const {
  const AlveolarRidge::Local l = ridge_.local(p);
  double d = smooth_min(ridge_mm(l), smooth_min(collars_mm(p), papillae_mm(p), 0.7), 1.4);
  if (palate_) d = smooth_min(d, palate_->distance_mm(p), 2.2);
  if (std::abs(d) < 1.0) {
    d += 0.04 * smooth_noise(p / 2.1 + unevenness_seed_) + 0.08 * smooth_noise(p / 4.7 - unevenness_seed_);
  }
  return d;
}

double Gingiva::beyond_rim_mm(const Vector3& p) const {
  const AlveolarRidge::Local l = ridge_.local(p);
  double beyond = ridge_.apical() * p.z() - l.at.rim_mm - kRimDepthMm;
  if (palate_) beyond = std::min(beyond, l.across_mm + 1.0);
  return std::max(beyond, p.y() - ridge_.end_y_mm());
}

Box Gingiva::box_mm() const {
  Box box;
  const double apical = ridge_.apical();
  double deepest = -1e9, occlusal = 1e9;
  for (const auto& s : ridge_.stations()) {
    if (s.point_mm.y() > ridge_.end_y_mm() + 3.0) continue;
    const Eigen::Vector2d outer = s.point_mm + 11.0 * s.outward;
    box.extend({outer.x(), outer.y(), 0.0});
    box.extend({s.point_mm.x(), s.point_mm.y(), 0.0});
    deepest = std::max(deepest, s.rim_mm + kRimDepthMm);
  }
  for (const PlacedTooth& t : arch_->teeth) {
    occlusal = std::min(occlusal, apical * t.to_jaw({0, 0, t.crown.form().height_mm + 1.8}).z() - 1.5);
  }
  if (palate_) deepest = std::max(deepest, palate_->highest_mm());
  deepest += 1.5;
  box.min_mm.z() = apical > 0 ? occlusal : -deepest;
  box.max_mm.z() = apical > 0 ? deepest : -occlusal;
  box.max_mm.y() = ridge_.end_y_mm() + 1.5;
  return box;
}

}  // namespace gnathion
