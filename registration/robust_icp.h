// Point-to-plane alignment of samples to a mesh with a redescending loss (Chen & Medioni 1991; Tukey's
// biweight, scale by the median absolute deviation).
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh_query.h"
#include "core/rigid.h"
#include "registration/surface_samples.h"

namespace gnathion {

/// One sample of the source and the plane of the target that it should lie in.
struct PlanePair {
  Vector3 source_mm;  ///< in the source's frame
  Vector3 target_mm;  ///< in the target's frame
  Vector3 normal;     ///< unit, in the target's frame
  std::uint32_t sample = 0;
  double weight = 1.0;  ///< 0..1, of the robust loss

  double residual_mm(const Rigid3& target_from_source) const {
    return normal.dot(target_from_source * source_mm - target_mm);
  }
  /// ∂residual/∂ξ for the left perturbation ξ = (rotation, translation).
  Vector6 jacobian(const Rigid3& target_from_source) const {
    Vector6 j;
    j << (target_from_source * source_mm).cross(normal), normal;
    return j;
  }
};

struct AssociationOptions {
  double gate_mm = 2.0;
  double min_normal_cosine = 0.5;
};

/// Pairs of the samples that have a counterpart: within the gate, facing alike, not on the target's rim.
/// `keep_target` (by triangle; empty = all) limits the target. Weights are 1.
std::vector<PlanePair> associate(const SurfaceSamples& source, const MeshQuery& target,
                                 const std::vector<bool>& keep_target, const Rigid3& target_from_source,
                                 const AssociationOptions& options);

/// 1.4826·MAD of the residuals about zero, at least `floor_mm`.
double robust_scale_mm(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                       double floor_mm);
/// Sets Tukey weights for the scale.
void weigh(std::vector<PlanePair>& pairs, const Rigid3& target_from_source, double scale_mm);
/// Σ w J Jᵀ, in the target's frame.
Matrix6 information(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source);

/// One Gauss–Newton step of the weighted residuals.
Rigid3 plane_step(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source);

struct IcpOptions {
  double first_gate_mm = 5.0, last_gate_mm = 2.0;
  double min_normal_cosine = 0.5;
  double noise_mm = 0.05;  ///< floor of the scale
  /// Steps smaller than this end it: correspondences jump from triangle to triangle, so that steps never
  /// vanish.
  double settled_mm = 3e-4;
  int max_iterations = 60;
};

struct IcpResult {
  Rigid3 target_from_source;
  std::vector<PlanePair> pairs;  ///< of the last iteration, weighted
  double scale_mm = 0.0;
  bool converged = false;
};

/// From a start within the first gate. Never fails: `converged` and the pairs tell.
IcpResult robust_icp(const SurfaceSamples& source, const MeshQuery& target,
                     const std::vector<bool>& keep_target, const Rigid3& start, const IcpOptions& options);

}  // namespace gnathion
