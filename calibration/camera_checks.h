// What speaks against a calibration: repeated views, empty parts of the image, a bent board, a lens that
// moves, two cameras in one. Internal.
#pragma once

#include "calibration/camera_refine.h"

namespace gnathion::camera_problem {

/// The same corners in the same places, to 2 px (RMS): a picture taken twice, or a board that stood still.
bool same_view(const BoardView& a, const BoardView& b);

CoverageMap coverage_of(const std::vector<View>& views, std::size_t camera, const Vector9& intrinsics,
                        int width_px, int height_px);

/// Whether the lens, as calibrated, folds the image over itself somewhere inside of it.
bool folds_over(const CameraModel& model);

/// Solves again with a bend of the board. For one camera.
BoardBend bend_of(const Problem& problem, const State& state, double noise_scale);

/// Standard deviation of the focal length from view to view beyond what noise explains, over f; 0 where noise
/// explains it.
double focal_drift(const std::vector<Reduced>& views, const Vector9& intrinsics, double noise_scale);

/// The views in two parts (true, false) that ask for two sets of intrinsics, and what each part alone comes
/// to.
struct Split {
  std::vector<bool> second;  ///< by instant
  double rms_together_px = 0, rms_apart_px = 0;
  double focal_px[2] = {0, 0};
  double separation_sigmas = 0;
};
/// The best split, or nothing where there are too few views. For one camera.
std::optional<Split> best_split(const Problem& problem, const State& state,
                                const std::vector<Reduced>& views);

}  // namespace gnathion::camera_problem
