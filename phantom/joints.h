// The phantom's joints as truth: surfaces, poles, and how far condyle and fossa are apart.
#pragma once

#include "phantom/jaws.h"

namespace gnathion {

/// Dental frame, the mandible in MI. Surfaces are those of PhantomJaws.
struct PhantomJoint {
  TriangleMesh condyle;  ///< closed
  TriangleMesh fossa;    ///< open; triangles face down, away from the bone
  Vector3 medial_pole_mm = Vector3::Zero(), lateral_pole_mm = Vector3::Zero();
  double distance_mm = 0.0;  ///< smallest between the two surfaces, of all pairs of triangles
  Vector3 on_condyle_mm = Vector3::Zero(), on_fossa_mm = Vector3::Zero();  ///< where it is
};
struct PhantomJoints {
  PhantomJoint left, right;
};
PhantomJoints phantom_joints(const PhantomJaws& jaws);

/// Smallest distance of two surfaces, over all pairs of their triangles, by exhaustive bounds and no tree:
/// slow, and independent of what anatomy/ does. 0 where they intersect.
struct SurfaceGap {
  double distance_mm = 0.0;
  Vector3 on_a_mm = Vector3::Zero(), on_b_mm = Vector3::Zero();
};
SurfaceGap smallest_gap(const TriangleMesh& a, const TriangleMesh& b);

}  // namespace gnathion
