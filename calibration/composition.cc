#include "calibration/composition.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "calibration/chain_derived.h"
#include "calibration/chain_problem.h"
#include "calibration/displacement.h"
#include "core/angle.h"
#include "registration/align.h"

namespace gnathion {
namespace {

Matrix6 symmetric(const Matrix6& m) {
  return 0.5 * (m + m.transpose());
}

Matrix6 carried(const Matrix6& jacobian, const Matrix6& covariance) {
  return jacobian * covariance * jacobian.transpose();
}

/// T_th = T_D⁻¹·A·T_D for a motion A of the bow in its own frame; its Jacobian by T_D.
/// T_D⁻¹ moves by −Ad_{T_D⁻¹}, the last T_D, behind T_D⁻¹·A, by Ad_{T_D⁻¹·A}.
TherapeuticEstimate from_bow_motion(const ChainPose& bow_from_dental, const Rigid3& motion_in_bow) {
  const Rigid3 dental_from_bow = bow_from_dental.value.inverse();
  TherapeuticEstimate e;
  e.therapeutic.value = Motion<Dental>(dental_from_bow * motion_in_bow * bow_from_dental.value);
  e.by_bow_from_dental = adjoint(dental_from_bow * motion_in_bow) - adjoint(dental_from_bow);
  e.therapeutic.covariance = carried(e.by_bow_from_dental, bow_from_dental.covariance);
  return e;
}

/// What of an estimate's covariance does not come from the shared T_D. Kept positive definite against
/// rounding.
Matrix6 own_covariance(const TherapeuticEstimate& e, const Matrix6& shared) {
  Matrix6 own = symmetric(e.therapeutic.covariance - carried(e.by_bow_from_dental, shared));
  const Eigen::SelfAdjointEigenSolver<Matrix6> solver(own);
  const double floor = 1e-12 * std::max(1e-12, solver.eigenvalues().cwiseAbs().maxCoeff());
  return solver.eigenvectors() * solver.eigenvalues().cwiseMax(floor).asDiagonal() *
         solver.eigenvectors().transpose();
}

ChainPose pose_of(const Alignment& first, const SurfaceTerm& term, const Rigid3& value,
                  const Matrix6& covariance) {
  ChainPose pose;
  pose.value = value;
  pose.covariance = symmetric(covariance);
  pose.rms_mm = term.rms_mm;
  pose.held_out_mm = term.held_out_mm;
  pose.condition = first.condition;
  pose.weak = first.weak;
  return pose;
}

SurfaceTerm arch_term(const char* name, const TriangleMesh& scan, const MeshQuery& surface,
                      std::uint64_t seed) {
  SurfaceTerm term;
  term.name = name;
  term.surface = &surface;
  const std::vector<bool> all(scan.triangles.size(), true);
  set_samples(term, sample_surface(scan, all, 10000, seed));
  term.scale_centre_mm = surface_centroid_mm(scan);
  term.surface_scale_centre_mm = surface_centroid_mm(surface.mesh());
  return term;
}

}  // namespace

TherapeuticEstimate therapeutic_from_faces(const Chain& chain) {
  const ChainDerived d = therapeutic_of(chain);
  TherapeuticEstimate e;
  e.therapeutic.value = Motion<Dental>(d.value);
  e.therapeutic.covariance = symmetric(d.jacobian * chain.joint * d.jacobian.transpose());
  e.by_bow_from_dental = d.jacobian.block<6, 6>(0, 6 * static_cast<int>(ChainState::kBowFromDental));
  return e;
}

TherapeuticEstimate therapeutic_from_camera(const ChainPose& bow_from_dental,
                                            const Uncertain<Transform<HeadFrame, Bow>>& head_from_bow_mi,
                                            const Uncertain<Transform<HeadFrame, Bow>>& head_from_bow_tp) {
  const Rigid3 bow_from_head = head_from_bow_mi.value.rigid.inverse();
  TherapeuticEstimate e = from_bow_motion(bow_from_dental, bow_from_head * head_from_bow_tp.value.rigid);
  // K0⁻¹ moves by −Ad_{T_D⁻¹K0⁻¹}, K1 behind it by the same with the other sign.
  const Matrix6 by_pose = adjoint(bow_from_dental.value.inverse() * bow_from_head);
  e.therapeutic.covariance += carried(by_pose, head_from_bow_mi.covariance + head_from_bow_tp.covariance);
  e.therapeutic.covariance = symmetric(e.therapeutic.covariance);
  return e;
}

TherapeuticEstimate therapeutic_from_camera(const ChainPose& bow_from_dental, const BowAndHead<Camera>& at_mi,
                                            const BowAndHead<Camera>& at_tp,
                                            const Matrix6& relative_motion_covariance) {
  const Motion<Camera> motion = relative_motion(at_mi, at_tp);
  const Rigid3 m0 = at_mi.f_from_bow.rigid;
  TherapeuticEstimate e = from_bow_motion(bow_from_dental, m0.inverse() * motion.rigid * m0);
  e.therapeutic.covariance +=
      carried(adjoint(bow_from_dental.value.inverse() * m0.inverse()), relative_motion_covariance);
  e.therapeutic.covariance = symmetric(e.therapeutic.covariance);
  return e;
}

double chi2_6_survival(double chi2) {
  return std::exp(-0.5 * chi2) * (1.0 + 0.5 * chi2 + 0.125 * chi2 * chi2);
}

RouteComparison compare_routes(const TherapeuticEstimate& a, const TherapeuticEstimate& b,
                               const Matrix6& shared, const std::vector<Vector3>& points_mm) {
  const Rigid3 &xa = a.therapeutic.value.rigid, &xb = b.therapeutic.value.rigid;
  RouteComparison c;
  c.difference = xa * xb.inverse();
  c.angle_deg = c.difference.angle_rad() * kDegPerRad;
  const Matrix6 covariance = own_covariance(a, shared) + own_covariance(b, shared) +
                             carried(a.by_bow_from_dental - b.by_bow_from_dental, shared);
  const Vector6 xi = log_se3(c.difference);
  const double chi2 = std::max(0.0, xi.dot(symmetric(covariance).ldlt().solve(xi)));
  c.mahalanobis = std::sqrt(chi2);
  c.chi2_p_value = chi2_6_survival(chi2);
  c.consistent = c.chi2_p_value >= 0.003;
  for (const Vector3& p : points_mm) c.largest_mm = std::max(c.largest_mm, (xa * p - xb * p).norm());
  return c;
}

TherapeuticEstimate fuse_routes(const TherapeuticEstimate& a, const TherapeuticEstimate& b,
                                const Matrix6& shared) {
  const Matrix6 own_a = own_covariance(a, shared), own_b = own_covariance(b, shared);
  // W = Σ_b(Σ_a + Σ_b)⁻¹ is a's weight; no inverse of the single covariances is needed.
  const Matrix6 weight_a = symmetric(own_a + own_b).ldlt().solve(own_b).transpose();
  const Matrix6 weight_b = Matrix6::Identity() - weight_a;
  const Rigid3& xb = b.therapeutic.value.rigid;
  const Vector6 apart = difference(a.therapeutic.value.rigid, xb);
  TherapeuticEstimate fused;
  fused.therapeutic.value = Motion<Dental>(exp_se3(weight_a * apart) * xb);
  fused.by_bow_from_dental = weight_a * a.by_bow_from_dental + weight_b * b.by_bow_from_dental;
  fused.therapeutic.covariance = symmetric(carried(weight_a, own_a) + carried(weight_b, own_b) +
                                           carried(fused.by_bow_from_dental, shared));
  return fused;
}

std::vector<LandmarkDisplacement> displacement_bounds(const Uncertain<Motion<Dental>>& therapeutic,
                                                      const std::vector<Vector3>& landmarks_mm) {
  std::vector<LandmarkDisplacement> out;
  for (const Vector3& p : landmarks_mm) {
    LandmarkDisplacement d;
    d.at_mm = p;
    const Vector3 moved = therapeutic.value * p;
    d.displacement_mm = moved - p;
    d.length_mm = d.displacement_mm.norm();
    d.covariance_mm2 = point_covariance(therapeutic.covariance, moved);
    d.bound95_mm = radius95_mm(d.covariance_mm2);
    out.push_back(d);
  }
  return out;
}

Result<TwoScanResult> therapeutic_from_scans(const TriangleMesh& maxilla_mi, const TriangleMesh& mandible_mi,
                                             const TriangleMesh& maxilla_tp, const TriangleMesh& mandible_tp,
                                             const ChainOptions& options, Progress& progress) {
  AlignOptions align;
  align.noise_mm = 0.03;
  align.gate_mm = 1.0;
  align.points = 2000;
  align.seed = options.seed;

  progress.begin_step("upper arches", 0.4);
  align.name = "maxilla in TP on maxilla in MI";
  GNATHION_TRY(const Alignment upper, align_surfaces(maxilla_tp, maxilla_mi, align));
  progress.begin_step("lower arches", 0.4);
  align.name = "mandible in MI on mandible in TP";
  GNATHION_TRY(const Alignment lower, align_surfaces(mandible_mi, mandible_tp, align));

  // Both together: the two sessions' scales are common to upper and lower arch.
  progress.begin_step("both arches together", 0.2);
  enum Session { kMi = 0, kTp };
  const MeshQuery maxilla(maxilla_mi), mandible(mandible_tp);
  ChainProblem problem;
  problem.poses = {upper.target_from_source, lower.target_from_source};
  problem.scale_sigmas = {options.scan_scale_sigma, options.scan_scale_sigma};
  problem.terms = {arch_term("upper arches", maxilla_tp, maxilla, options.seed),
                   arch_term("lower arches", mandible_mi, mandible, options.seed + 1)};
  std::vector<SurfaceTerm>& terms = problem.terms;
  terms[0].scanner = terms[1].surface_scanner = kTp;
  terms[0].surface_scanner = terms[1].scanner = kMi;
  terms[1].right = 1;
  GNATHION_TRY(const ChainSolution solution, solve_poses(problem));

  // L_th = T·L1 with T by the upper arches; T_th brings L0 there. Left perturbations: U by itself, L through
  // Ad_U.
  TwoScanResult result;
  const Rigid3 &u = solution.poses[0], &l = solution.poses[1];
  result.dental_from_intraoral_tp = pose_of(upper, terms[0], u, solution.covariance.topLeftCorner<6, 6>());
  result.mandible = pose_of(lower, terms[1], l, solution.covariance.bottomRightCorner<6, 6>());
  result.cross_covariance = solution.covariance.topRightCorner<6, 6>();
  Eigen::Matrix<double, 6, 12> jacobian;
  jacobian << Matrix6::Identity(), adjoint(u);
  result.therapeutic.value = Motion<Dental>(u * l);
  result.therapeutic.covariance = symmetric(jacobian * solution.covariance * jacobian.transpose());
  return result;
}

}  // namespace gnathion
