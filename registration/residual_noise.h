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
  double white_sigma_mm = 0.0;
  double correlated_sigma_mm = 0.0;
  double length_mm = 0.0;  ///< ℓ
  /// True: a field of displacement vectors (the correlation of residuals carries nᵢ·nⱼ); false: of depths
  /// along the normals. Whichever the residuals prefer.
  bool vector_field = false;
};

/// From the pairs with weight > 0; at most a few hundred of them are used.
ResidualNoise estimate_noise(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source);

/// Covariance of Σ w J r, the score of the fit: white part over all pairs, correlated part over all couples
/// of them.
Matrix6 score_covariance(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                         const ResidualNoise& noise);

/// Σ w J ∂r/∂scale: what a relative scale of the source, about its centroid, does to the score.
Vector6 scale_score(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source);

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
