// Two rigid bodies pressed together until they rest: where friction-free, nearly hard surfaces come to
// equilibrium under one force.
#pragma once

#include <memory>
#include <vector>

#include "core/mesh_query.h"
#include "core/rigid.h"

namespace gnathion {

/// Where the moving body may touch the one at rest.
struct TouchPoint {
  Vector3 p_mm;           ///< on the moving body
  Vector3 normal;         ///< unit, out of the body at rest
  double gap_mm = 0.0;    ///< along it; negative: overlapping
  double area_mm2 = 0.0;  ///< of the surface that the point stands for
};

/// Of the parts of `moving` whose triangles are marked (empty: all) and of the vertices of `at_rest`, what is
/// nearer than `reach_mm`. Both closed, in one frame.
std::vector<TouchPoint> touch_points(const MeshQuery& at_rest, const MeshQuery& moving,
                                     const std::vector<bool>& moving_triangles, double reach_mm);

/// A force on the moving body, N, through a point.
struct PressingForce {
  Vector3 force_n;
  Vector3 through_mm;
};

struct Settled {
  Rigid3 motion;            ///< of the moving body, in the common frame
  double deepest_mm = 0.0;  ///< overlap that remains under the force
  bool at_rest = true;      ///< false: the force is not held; it slides away
};

/// The touching area as a stiff elastic foundation (Winkler), under forces through one point. One thread at a
/// time.
class ElasticFoundation {
 public:
  ElasticFoundation(const std::vector<TouchPoint>& points, const Vector3& through_mm,
                    double stiffness_n_per_mm3 = 2e5);
  ~ElasticFoundation();
  /// As settled().
  Settled under(const Vector3& force_n);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Minimum of the potential of the force and of a stiff elastic foundation on the touching area (Winkler;
/// `stiffness_n_per_mm3`), by damped Newton steps. Touch points keep their planes: valid for
/// movements of a few tenths of a millimetre. What neither force nor touch determines stays as it is.
Settled settled(const std::vector<TouchPoint>& points, const PressingForce& force,
                double stiffness_n_per_mm3 = 2e5);

}  // namespace gnathion
