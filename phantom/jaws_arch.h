// Where the crowns stand: two arches laid on one curve, so that each functional cusp line of one jaw follows
// the fossa line of the other.
#pragma once

#include <cstdint>
#include <vector>

#include "core/random.h"
#include "phantom/tooth.h"

namespace gnathion {

/// What differs from one patient to another, beside the single teeth.
struct ArchPlan {
  double width_mm = 54.0;  ///< between the lower buccal cusp lines at their end
  double depth_mm = 38.5;  ///< from the lower incisal edges to that end
  double overjet_mm = 2.4, overbite_mm = 1.6;
  double spee_radius_mm = 95.0, wilson_radius_mm = 150.0;
  double lateral_skew = 0.0;  ///< one side of the arch wider than the other
};
ArchPlan random_arch_plan(Random& random);

/// A crown in its place. The axes may form a left-handed frame: left and right teeth are mirror images.
struct PlacedTooth {
  int fdi = 0;
  Crown crown;
  Matrix3 jaw_from_tooth = Matrix3::Identity();  ///< columns: mesial, buccal, occlusal
  Vector3 origin_mm = Vector3::Zero();           ///< centre of the cervix
  Vector3 unevenness_seed = Vector3::Zero();

  int number() const { return fdi % 10; }
  bool posterior() const { return number() >= 4; }
  Vector3 to_jaw(const Vector3& p_mm) const { return jaw_from_tooth * p_mm + origin_mm; }
  Vector3 to_tooth(const Vector3& p_mm) const { return jaw_from_tooth.transpose() * (p_mm - origin_mm); }
  Vector3 centre_mm() const { return to_jaw({0.0, 0.0, 0.5 * crown.form().height_mm}); }
  /// Distance to the crown in the jaw's frame, with the faint unevenness of enamel.
  double distance_mm(const Vector3& p_mm) const;
  double radius_mm() const { return crown.radius_mm(); }
};

/// Fourteen teeth from the right second molar round to the left one.
struct DentalArch {
  bool upper = false;
  std::vector<PlacedTooth> teeth;
  /// Distance to the nearest crown; far away only a lower bound of it.
  double crowns_mm(const Vector3& p_mm) const;
  PlacedTooth& tooth(int fdi);
  const PlacedTooth& tooth(int fdi) const;
};

/// Where two neighbours touch.
Vector3 contact_point_mm(const PlacedTooth& a, const PlacedTooth& b);

struct DentalArches {
  DentalArch upper, lower;
};

/// Teeth of both jaws in class I, each touching its neighbours, not yet settled into occlusion.
/// Frame: as Dental, but with the height of the lower incisal edges at about 0.
DentalArches lay_out_arches(const ArchPlan& plan, Random& random);

/// Waxes the functional cusps up or down and lets the front teeth erupt, until the jaws meet: every
/// functional cusp within a hundredth or two of a millimetre of the opposite jaw.
void settle_into_occlusion(DentalArches& arches);

/// Smooth noise of amplitude about 1 and wavelength about 1, zero mean.
double smooth_noise(const Vector3& p);

}  // namespace gnathion
