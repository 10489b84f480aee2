// Robust mean of poses on SE(3).
#pragma once

#include <vector>

#include "core/rigid.h"

namespace gnathion {

struct PoseMean {
  Rigid3 mean;
  Matrix6 sample_covariance = Matrix6::Zero();  ///< of one pose about the mean, left perturbation
  Matrix6 mean_covariance = Matrix6::Zero();    ///< of the mean: sample covariance / effective count
  double effective_count = 0;                   ///< samples worth of independent information
  int used = 0;                                 ///< with a robust weight above one half
};

/// Iterated logarithmic mean: Σ w_i log(X_i X̄⁻¹) = 0, with Tukey weights on the error normalised by the
/// spread. `poses` in order of time: neighbours' correlation (lags until it vanishes) lowers the effective
/// count. `lever_mm` weighs rotation against translation in the robust distance: 1 rad counts as that many
/// mm.
PoseMean robust_mean(const std::vector<Rigid3>& poses, double lever_mm = 80.0);

}  // namespace gnathion
