// The clutch as a solid: what of it belongs to the lower teeth, and where it has to end.
#pragma once

#include <array>
#include <vector>

#include "core/mesh_query.h"
#include "phantom/bow.h"

namespace gnathion {

/// A piecewise linear function of x, constant beyond its ends.
class Profile {
 public:
  explicit Profile(std::vector<std::array<double, 2>> points);  ///< sorted here by the first number
  double operator()(double x) const;

 private:
  std::vector<std::array<double, 2>> points_;
};

/// Distance fields around the lower front teeth (44 to 34), in the Dental frame.
class ClutchField {
 public:
  ClutchField(const PhantomJaws& jaws, const ClutchDesign& design);
  /// About the signed distance to the clutch's shell; large beyond its surroundings.
  double shell(const Vector3& p_mm) const;
  /// `solid` with room cut out for the teeth, and for the maxilla in MI.
  double with_room_for_teeth(double solid, const Vector3& p_mm) const;
  double top_z_mm(double x_mm) const { return top_(x_mm); }
  double bottom_z_mm(double x_mm) const { return bottom_(x_mm); }
  /// Most anterior point of the teeth at mid-height of the clutch, in the midline.
  double front_y_mm() const { return front_y_mm_; }
  double back_y_mm() const { return near_.max_mm.y(); }

 private:
  double outside_of_arch_mm(const Vector3& p) const;
  double beyond_ends_mm(const Vector3& p) const;
  /// Distance to the lower teeth, negative inside; at most `kFar_mm`.
  double from_teeth_mm(const Vector3& p) const;
  double from_maxilla_mm(const Vector3& p) const;

  static constexpr double kFar_mm = 6.0;
  ClutchDesign design_;
  MeshQuery mandible_, maxilla_;
  std::vector<Vector3> arch_;  ///< middles of the crowns 44 … 34, at z = 0
  Profile top_, bottom_;
  Box near_;
  double front_y_mm_ = 0.0;
};

}  // namespace gnathion
