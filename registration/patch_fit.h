// Generalised least squares for fits whose residuals are alike over centimetres (Aitken 1935).
//
// Where neighbouring residuals err together, differences between neighbours are worth more than the residuals
// themselves: a scanner's bulge moves a whole plate, but not its edges against each other. r'V⁻¹r weighs them
// so. V over all points is too large to invert; points of one patch, much smaller than the noise's range and
// facing alike, share their correlated error and become one mean residual.
#pragma once

#include <vector>

#include "registration/residual_noise.h"

namespace gnathion {

/// Mean residuals of patches, linear in the unknowns: r(ξ) = residual + jacobian·ξ with noise of
/// `covariance`.
struct PatchSystem {
  Eigen::VectorXd residual_mm;  ///< P
  Eigen::MatrixXd jacobian;     ///< P×U
  Eigen::VectorXd weight;       ///< Σ of the pairs' weights, P
  Eigen::MatrixXd covariance;   ///< P×P, mm²
};

/// Patches of the pairs with weight > 0. `rows`: a pair's Jacobian in each column, at most 8 unknowns.
PatchSystem patches_of(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                       const ScoreRows& rows, const ResidualNoise& noise);

/// JᵀV⁻¹J and JᵀV⁻¹r; the former is also the covariance of the latter.
struct GeneralisedScore {
  Eigen::MatrixXd information;
  Eigen::VectorXd score;
};
GeneralisedScore generalised_score(const PatchSystem& patches);

/// Whether the noise is what V takes it for. Ordinary and generalised least squares estimate the same pose,
/// and by how much they may differ follows from V alone (Hausman, "Specification tests in econometrics",
/// 1978); and what the generalised fit leaves, r'V⁻¹r, is as large as its freedom.
struct Disagreement {
  double chi2 = 0.0;
  int freedom = 0;
  double rest_chi2 = 0.0;
  int rest_freedom = 0;
};
/// Of the first 6 unknowns, a pose; the others (scales) are known to `other_sigmas`.
Disagreement disagreement(const PatchSystem& patches, const Eigen::VectorXd& other_sigmas);

}  // namespace gnathion
