// The joint least-squares problem over the chain's poses: point-to-plane residuals of every registration at
// once.
//
// Residuals of a scan are correlated over centimetres, so that six thousand points tell far less than six
// thousand numbers would. Each registration enters by its score H·ξ + g with noise M = Cov(g), in one of two
// ways:
//
// - generalised (registration/patch_fit.h): H = JᵀV⁻¹J, g = JᵀV⁻¹r, λ = 1, M = H, with the covariance V of
// the
//   residuals as their restricted likelihood has it. Half the error of the other way, if V is right;
// - ordinary: H = Σ w J Jᵀ, g = Σ w J r, all points alike, and between registrations λ = 6/tr(H⁻¹M), one over
//   the mean noise. It leans on V for its forecast only.
//
// All are solved the ordinary way first. Where both ways then differ by more than V allows (surfaces that a
// scanner bends, blurs or rounds off), the ordinary one stands, and its noise is widened by as much as V was
// wrong. Ceres minimises Σ λ (H·ξ + g)ᵀ H⁻¹ (H·ξ + g) over all poses and scales on SE(3). With B = (Σ λH)⁻¹
// the covariance is B·(Σ λ²M)·B.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/mesh_query.h"
#include "core/result.h"
#include "registration/patch_fit.h"
#include "registration/residual_noise.h"
#include "registration/robust_icp.h"
#include "registration/shared_shape.h"
#include "registration/surface_samples.h"

namespace gnathion {

/// One registration of the chain: samples of a scan and the surface that they lie on. The pose that brings
/// them together is poses[right], or poses[left]⁻¹·poses[right].
struct SurfaceTerm {
  std::string name;
  SurfaceSamples fitted, held_out;
  const MeshQuery* surface = nullptr;
  std::vector<bool> keep;  ///< of the surface's triangles; empty: all
  std::optional<int> left;
  int right = 0;
  double gate_mm = 1.0;
  double min_normal_cosine = 0.95;
  double noise_floor_mm = 0.01;
  /// The loss never widens beyond this scale: what does not fit so well is not rigid.
  double scale_cap_mm = 1e9;
  /// Scanners whose scale the samples and the surface carry (index into scale sigmas), −1: none (CAD). A scan
  /// is (1 + s) times too large about its centre; s is estimated along, with the scanner's sigma as prior.
  int scanner = -1, surface_scanner = -1;
  Vector3 scale_centre_mm = Vector3::Zero(), surface_scale_centre_mm = Vector3::Zero();
  /// Terms of one pool have one noise, estimated from all of them.
  int noise_pool = 0;
  /// False: never generalised; what the surface does besides noise (skin) is not to be trusted in its
  /// details.
  bool rigid = true;

  // Results.
  double source_scale = 0.0, surface_scale = 0.0;  ///< s of the samples' and the surface's scanner
  std::vector<PlanePair> pairs;
  double scale_mm = 0.0;
  ResidualNoise noise;
  std::shared_ptr<const PatchModel> patches;
  bool generalised = false;
  double widened = 1.0;  ///< of the noise's variance, ≥ 1
  /// Of the surface against its model, if all scans of it agree on one; shared by them.
  std::shared_ptr<const BodyShape> shape;
  double rms_mm = 0.0, held_out_mm = 0.0;
};

/// Splits samples: every fifth is held out.
void set_samples(SurfaceTerm& term, const SurfaceSamples& all);

/// What is known of a pose from elsewhere (a tracker).
struct KnownPose {
  int pose = 0;
  Rigid3 value;
  Matrix6 covariance = Matrix6::Identity();  ///< of the left perturbation
};

struct ChainProblem {
  std::vector<Rigid3> poses;  ///< where to start
  std::vector<bool> fixed;    ///< by pose; empty: none
  std::vector<SurfaceTerm> terms;
  std::vector<double> scale_sigmas;  ///< by scanner
  std::vector<KnownPose> known;
};

struct ChainSolution {
  std::vector<Rigid3> poses;
  std::vector<double> scales;  ///< s of each scanner
  /// Of all poses' left perturbations, 6 each, correlated noise and scales included; zero for fixed ones.
  Eigen::MatrixXd covariance;
};

/// Associates, solves (Ceres), associates again until the poses stand still; then the covariance. Terms come
/// back with their results. Errors (kInput) name a term with too few points, or the pose that has a direction
/// which nothing determines.
Result<ChainSolution> solve_poses(ChainProblem& problem);

/// The pose of a term.
Rigid3 pose_of(const SurfaceTerm& term, const std::vector<Rigid3>& poses);

}  // namespace gnathion
