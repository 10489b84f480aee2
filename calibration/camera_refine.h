// The solution of a calibration problem with its noise, and how well it foretells views that it has not seen.
// Internal.
#pragma once

#include "calibration/camera_problem.h"

namespace gnathion::camera_problem {

/// Cauchy's loss first; then the noise beyond the detector's covariances is estimated from the residuals,
/// corners beyond 4.5 σ are put aside, and what is left is solved again. Returns √(χ²/dof), or nothing where
/// nothing converges.
std::optional<double> refine(Problem* problem, double loss_sigmas, State* state);

/// What cross-validation tells of one view; RMS, px, √(mean of dx² + dy²).
struct HeldOut {
  std::optional<double> own;  ///< pose from one half of the view's corners, error from the other
  std::optional<double> rig;  ///< pose from the instant's first camera; nothing for that one itself
  std::size_t corners = 0;
};
/// Instants are left out in `folds` blocks of neighbours. By view.
std::vector<HeldOut> cross_validate(const Problem& problem, const State& state, int folds);

/// √ of the mean square over views, weighted by their corners.
double total(const std::vector<HeldOut>& views, std::optional<double> HeldOut::*which);

/// √(mean of dx² + dy²) over all corners, outliers included; of one camera or (−1) of all.
double rms_px(const Problem& problem, const State& state, int camera);

}  // namespace gnathion::camera_problem
