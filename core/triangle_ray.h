// Watertight ray–triangle crossing in double precision (Woop, Benthin & Wald, JCGT 2013): a ray towards an
// edge that two triangles share meets at least one of them, however it is rounded.
#pragma once

#include "core/rigid.h"

namespace gnathion {

struct RayCrossing {
  enum Kind {
    kNone,
    kInside,  ///< well within the triangle
    kOnRim,   ///< through an edge or a vertex, as far as double precision can tell
    kEdgeOn,  ///< the ray lies in the triangle's plane, or the triangle has no area
  };
  Kind kind = kNone;
  double distance_mm = 0.0;  ///< from the ray's origin
};

class RayInDouble {
 public:
  /// From `start_mm` along the ray on; `direction` is of unit length.
  RayInDouble(const Vector3& origin_mm, const Vector3& direction, double start_mm);

  RayCrossing cross(const Vector3& a, const Vector3& b, const Vector3& c) const;
  Vector3 point_at(double distance_mm) const { return origin_ + distance_mm * direction_; }
  const Vector3& direction() const { return direction_; }
  double start_mm() const { return start_mm_; }

  double slack_mm = 0.0;  ///< how far single precision may misplace a crossing

 private:
  Vector3 origin_, direction_, start_;
  double start_mm_;
  int x_, y_, z_;  // z: the direction's largest axis
  double shear_x_, shear_y_, shear_z_;
};

}  // namespace gnathion
