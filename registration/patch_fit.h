// Generalised least squares for fits whose residuals are alike over centimetres (Aitken 1935).
//
// Where neighbouring residuals err together, differences between neighbours are worth more than the residuals
// themselves: a scanner's bulge moves a whole plate, but not its edges against each other. r'V⁻¹r weighs them
// so. V over all points is too large to invert; points of one patch, much smaller than the noise's range and
// facing alike, share their correlated error and become one mean residual.
#pragma once

#include <Eigen/Cholesky>
#include <vector>

#include "registration/residual_noise.h"

namespace gnathion {

/// JᵀV⁻¹J and JᵀV⁻¹r; the former is also the covariance of the latter.
struct GeneralisedScore {
  Eigen::MatrixXd information;
  Eigen::VectorXd score;
};

/// Whether the noise is what V takes it for. Ordinary and generalised least squares estimate the same pose,
/// and by how much they may differ follows from V alone (Hausman, "Specification tests in econometrics",
/// 1978); and what the generalised fit leaves, r'V⁻¹r, is as large as its freedom.
struct Disagreement {
  double chi2 = 0.0;
  int freedom = 0;
  double rest_chi2 = 0.0;
  int rest_freedom = 0;
};

/// The patches of a fit and V of their mean residuals. V changes little while a fit settles and costs most:
/// it is made once, near the solution, and the means are taken anew for each pose.
class PatchModel {
 public:
  /// Patches of the pairs with weight > 0; nothing of them is kept but which sample is in which patch.
  PatchModel(const std::vector<PlanePair>& pairs, const ResidualNoise& noise);

  /// Linear in the unknowns about the pose; `rows`: a pair's Jacobian in each column, at most 8 unknowns.
  /// A patch that has lost its pairs says nothing; samples that came later are left out.
  GeneralisedScore score(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                         const ScoreRows& rows) const;
  /// Of further unknowns (`beside`, as many rows as unknowns), with those of `rows` estimated along: the
  /// score and information that remain for them.
  GeneralisedScore score_beside(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                                const ScoreRows& rows, const Eigen::MatrixXd& beside) const;
  /// JᵀV⁻¹W: how the score of `rows` changes with the further unknowns.
  Eigen::MatrixXd cross(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                        const ScoreRows& rows, const Eigen::MatrixXd& beside) const;
  /// Of the first 6 unknowns, a pose; the others (scales) are known to `other_sigmas`.
  Disagreement disagreement(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                            const ScoreRows& rows, const Eigen::VectorXd& other_sigmas) const;

 private:
  struct Means;
  Means means(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
              const Eigen::Ref<const Eigen::MatrixXd>& rows) const;
  struct Whitened;
  Whitened whitened(const Means& means) const;
  std::vector<int> patch_of_sample_;  // −1: in none
  Eigen::LLT<Eigen::MatrixXd> covariance_mm2_;
};

}  // namespace gnathion
