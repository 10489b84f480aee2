// Signed distance to a scan closed to a solid.
#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "core/mesh_query.h"

namespace gnathion {

/// As MeshQuery::signed_distance; but scans fold back over themselves at crests and in fissures, where the
/// closest normal misleads: off the surface, a ray must agree with it, or the majority of three rays decides.
std::optional<SignedDistance> solid_distance(const MeshQuery& solid, const Vector3& p_mm,
                                             double max_distance_mm);

/// The same for points that lie close together, gathered for by `local`. A ball about a point that does not
/// reach the surface lies on one side of it, so most points have their side from a neighbour and ask no ray.
class SolidGroup {
 public:
  explicit SolidGroup(const MeshQuery& solid);
  /// `on_surface_mm`: nearer than this the closest normal tells the side.
  SolidGroup(const MeshQuery& solid, double on_surface_mm);
  struct Point {
    Vector3 p_mm;
    double reach_mm = 0.0;
    bool found = false;  ///< a closest point within reach
    SignedDistance distance;
  };
  /// Answers for every point.
  void measure(std::vector<Point>& points);

 private:
  const MeshQuery& solid_;
  double on_surface_mm_;
  LocalQuery local_;
  std::vector<std::size_t> order_;
};

/// solid_distance() for many points, in parallel: +infinity where the surface is farther than the reach.
struct SolidHit {
  double distance_mm = std::numeric_limits<double>::infinity();
  Vector3 point_mm = Vector3::Zero();  ///< closest on the surface
  Vector3 normal = Vector3::Zero();    ///< unit, out of the solid: the distance's gradient
};
std::vector<SolidHit> solid_hits(const MeshQuery& solid, const std::vector<Vector3>& points_mm,
                                 double max_distance_mm);

}  // namespace gnathion
