// What the residuals of a fit say about its uncertainty when neighbouring residuals are alike.
//
// Scanner noise is correlated over about 10 mm. Taken as independent, ten thousand residuals would promise a
// pose ten times better than it is. The noise is modelled as white plus a part with correlation exp(−d²/2ℓ²),
// whose two variances and range are estimated from the residuals by restricted maximum likelihood (Patterson
// & Thompson 1971), which accounts for what the fit itself took out of them.
#pragma once

#include <string>
#include <vector>

#include "registration/robust_icp.h"

namespace gnathion {

struct ResidualNoise {
  /// One description of the noise that the residuals allow.
  struct Model {
    double probability = 1.0;
    double white_sigma_mm = 0.0;
    double correlated_sigma_mm = 0.0;
    double length_mm = 10.0;  ///< ℓ
    /// True: a field of displacement vectors (the correlation of residuals carries nᵢ·nⱼ); false: of depths
    /// along the normals.
    bool vector_field = false;
  };
  /// Residuals seldom tell the range sharply; all models that they allow count, by their likelihood.
  std::vector<Model> models;
  double white_sigma_mm() const;
  double correlated_sigma_mm() const;
  double length_mm() const;  ///< mean over the models, weighted by correlated variance
};

/// From the pairs with weight > 0; at most a few hundred of them are used.
ResidualNoise estimate_noise(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source);
/// One fit among several with the same noise, independent of one another.
struct FitResiduals {
  const std::vector<PlanePair>* pairs = nullptr;
  Rigid3 target_from_source;
};
ResidualNoise estimate_noise(const std::vector<FitResiduals>& fits);

/// Covariance of Σ w J r, the score of the fit: white part over all pairs, correlated part over all couples
/// of them.
Matrix6 score_covariance(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                         const ResidualNoise& noise);
/// The same for any Jacobians: a column of `rows` for each pair, at most 8 unknowns.
using ScoreRows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 8>;
Eigen::MatrixXd score_covariance(const std::vector<PlanePair>& pairs, const ScoreRows& rows,
                                 const ResidualNoise& noise);

/// Σ w J ∂r/∂s for a source that is (1 + s) too large about `centre_mm` (source frame).
Vector6 source_scale_score(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                           const Vector3& centre_mm);
/// How well the information determines the pose: lengths scaled by the cloud's radius, about its centroid.
struct Conditioning {
  double condition = 0.0;
  std::vector<std::string> weak;
};
Conditioning conditioning(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                          const Matrix6& covariance);

/// √(Σ w r² / Σ w) over the pairs with weight > 0.
double weighted_rms_mm(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source);

}  // namespace gnathion
