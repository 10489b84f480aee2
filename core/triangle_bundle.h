// Four triangles side by side: which of them can lie within a distance at all, told in single precision.
#pragma once

#include <cstdint>

#include "core/rigid.h"

namespace gnathion {

/// Coordinates are told from a centre near the triangles and the points, mm. Never leaves out a triangle that
/// is near enough: each has the room that rounding to single precision takes.
class TriangleBundle {
 public:
  static constexpr int kLanes = 4;

  /// `reach_mm`: no point that is asked for lies farther from the centre.
  void set(int lane, const Vector3& a, const Vector3& b, const Vector3& c, double reach_mm);
  /// Bit k: triangle k may have a point within `within_mm` of p. Lanes never set have none.
  unsigned near(const Eigen::Vector3f& p, float within_mm) const;

 private:
  using Lanes = float __attribute__((vector_size(4 * kLanes)));
  struct Vector3Lanes {
    Lanes x{}, y{}, z{};
  };
  static Lanes dot(const Vector3Lanes& a, const Vector3Lanes& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
  static Lanes side_squared(const Vector3Lanes& to_p, const Vector3Lanes& side, const Lanes& part);

  Vector3Lanes a_, ab_, ac_;
  Lanes ab2_{}, ac2_{}, abac_{};
  Lanes by_ab2_{}, by_ac2_{}, by_bc2_{}, by_area2_{};  // reciprocals; 0 where there is nothing to divide by
  Lanes room_mm_{-1e30f, -1e30f, -1e30f, -1e30f};
};

}  // namespace gnathion
