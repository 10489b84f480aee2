// A registration's points condensed into its score, and that score as a residual for Ceres.
#pragma once

#include <ceres/sized_cost_function.h>

#include "calibration/chain_problem.h"

namespace gnathion {

/// H·(ξ, δs) + g of a term at one pose. Unknowns: the left perturbation of the term's pose, then the scales
/// of its scanners.
struct TermScore {
  Rigid3 at;
  std::vector<int> scanners;
  std::vector<double> scales_at;
  Eigen::MatrixXd information;  ///< H
  Eigen::VectorXd score;        ///< g
  double weight = 1.0;          ///< λ, 1/mm²
};

/// The scanners whose scales a term depends on, each once.
std::vector<int> scanners_of(const SurfaceTerm& term);
/// H and g from the term's pairs and their weights; λ as if residuals were independent with the term's scale.
TermScore score_of(const SurfaceTerm& term, const Rigid3& pose);
/// M = Cov(g) with the term's own noise model.
Eigen::MatrixXd score_noise(const SurfaceTerm& term, const Rigid3& pose);
/// The same two as generalised least squares has them, λ = 1/widened; M = widened·H.
TermScore generalised_score_of(const SurfaceTerm& term, const Rigid3& pose);
/// Of the two ways, for a term that has its patches; scales known to `scale_sigmas` (by scanner).
Disagreement disagreement_of(const SurfaceTerm& term, const Rigid3& pose,
                             const std::vector<double>& scale_sigmas);
/// A term as one of several fits to its surface, for what they say about its shape.
ShapeFit shape_fit_of(const SurfaceTerm& term, const Rigid3& pose);
ShapeModes shape_modes_of(const MeshQuery& surface);
/// How g changes with the sizes of the surface's modes.
Eigen::MatrixXd score_by_shape(const SurfaceTerm& term, const Rigid3& pose);
/// λ = 6/tr(H⁻¹M) over the pose.
double score_weight(const TermScore& score, const Eigen::MatrixXd& noise);

/// √λ·H^(−1/2)·(H·(ξ, δs) + g). Parameter blocks: poses[left] if any, poses[right], then the scales.
class ScoreCost final : public ceres::CostFunction {
 public:
  ScoreCost(const TermScore& score, bool has_left);
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  Rigid3 at_;
  std::vector<double> scales_at_;
  Eigen::MatrixXd slope_;  // √λ·H^(1/2)
  Eigen::VectorXd offset_;
  bool has_left_;
};

/// Σ^(−1/2)·log(X·X̂⁻¹) of a pose that is known from elsewhere.
class KnownPoseCost final : public ceres::SizedCostFunction<6, 7> {
 public:
  explicit KnownPoseCost(const KnownPose& known);
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  Rigid3 value_;
  Matrix6 whiten_;
};

/// The scanner's promise about its scale: s/σ.
class ScalePrior final : public ceres::SizedCostFunction<1, 1> {
 public:
  explicit ScalePrior(double sigma) : sigma_(sigma) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  double sigma_;
};

}  // namespace gnathion
