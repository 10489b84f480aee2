// T_th from the parts of the chain, by three routes, with covariance; comparing and fusing the routes.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "calibration/chain.h"
#include "core/mesh.h"
#include "core/result.h"
#include "core/transform.h"

namespace gnathion {

/// T_th and how it hangs together with T_D, which the routes share.
struct TherapeuticEstimate {
  Uncertain<Motion<Dental>> therapeutic;
  /// ∂ξ_th/∂ξ_D: how a left perturbation of bow_from_dental moves T_th; zero for routes without T_D.
  Matrix6 by_bow_from_dental = Matrix6::Zero();
};

/// Face route: T_th = T_D⁻¹·(T_F·F·B1⁻¹)·T_D with the chain's joint covariance (F = face_mi_from_face_tp, B1
/// = bow_from_face_tp). The bow at MI enters T and T_B alike; taken jointly, its cross terms are all there.
TherapeuticEstimate therapeutic_from_faces(const Chain& chain);

/// Camera route: T_th = T_D⁻¹·K0⁻¹·K1·T_D with K = H⁻¹·M, the bow's pose in the head frame. Covariances of K0
/// and K1 are taken as independent of each other and of T_D.
TherapeuticEstimate therapeutic_from_camera(const ChainPose& bow_from_dental,
                                            const Uncertain<Transform<HeadFrame, Bow>>& head_from_bow_mi,
                                            const Uncertain<Transform<HeadFrame, Bow>>& head_from_bow_tp);
/// The same from poses in the camera; `relative_motion_covariance` is that of relative_motion(at_mi, at_tp),
/// in the camera's frame at MI.
TherapeuticEstimate therapeutic_from_camera(const ChainPose& bow_from_dental, const BowAndHead<Camera>& at_mi,
                                            const BowAndHead<Camera>& at_tp,
                                            const Matrix6& relative_motion_covariance);

/// The share of χ² with 6 degrees of freedom that lies beyond `chi2`, in closed form.
double chi2_6_survival(double chi2);

/// How far two routes are apart.
struct RouteComparison {
  Rigid3 difference;  ///< a·b⁻¹
  double angle_deg = 0.0;
  double mahalanobis = 0.0;   ///< √(ξᵀ Σ⁻¹ ξ), the shared T_D's part taken out of Σ
  double chi2_p_value = 1.0;  ///< of mahalanobis² with 6 degrees of freedom
  bool consistent = true;     ///< p ≥ 0.003 (3σ)
  double largest_mm = 0.0;    ///< over the given points
};
/// `shared` is the covariance of the bow_from_dental that both routes used (zero: they share nothing).
RouteComparison compare_routes(const TherapeuticEstimate& a, const TherapeuticEstimate& b,
                               const Matrix6& shared, const std::vector<Vector3>& points_mm);
/// Weighted mean on SE(3). What both owe to the shared T_D is no independent evidence and is not averaged
/// away.
TherapeuticEstimate fuse_routes(const TherapeuticEstimate& a, const TherapeuticEstimate& b,
                                const Matrix6& shared);

/// A displacement with its 95 % bounds.
struct LandmarkDisplacement {
  Vector3 at_mm;  ///< the landmark in MI
  Vector3 displacement_mm;
  Matrix3 covariance_mm2;
  double length_mm = 0.0;
  double bound95_mm = 0.0;  ///< radius95_mm of the covariance
};
std::vector<LandmarkDisplacement> displacement_bounds(const Uncertain<Motion<Dental>>& therapeutic,
                                                      const std::vector<Vector3>& landmarks_mm);

/// T_th from two pairs of intraoral scans (appendix A.1): U1→U0, then L0→L_th.
struct TwoScanResult {
  Uncertain<Motion<Dental>> therapeutic;
  ChainPose dental_from_intraoral_tp;          ///< of the upper arches
  ChainPose mandible;                          ///< intraoral_tp_from_dental by the lower arches
  Matrix6 cross_covariance = Matrix6::Zero();  ///< of the two: the sessions' scales are common to both
};
/// Errors (kInput) name the arch whose registration is undetermined.
Result<TwoScanResult> therapeutic_from_scans(const TriangleMesh& maxilla_mi, const TriangleMesh& mandible_mi,
                                             const TriangleMesh& maxilla_tp, const TriangleMesh& mandible_tp,
                                             const ChainOptions& options, Progress& progress);

}  // namespace gnathion
