// Smoothed jaw motion: Rauch–Tung–Striebel on SE(3). The raw motion is kept beside it.
#pragma once

#include <optional>
#include <vector>

#include "core/transform.h"
#include "tracking/session_motion.h"

namespace gnathion {

struct SmoothingOptions {
  /// Spectral density of the jerk (white): rotation rad²/s⁵ and translation mm²/s⁵ at the reference point.
  /// Not given: the most likely ones for the recording's own innovations.
  std::optional<double> rotation_density, translation_density;
  double gap_s = 0.25;  ///< rows farther apart than this are not bridged: the motion begins anew
  Vector3 point_in_bow_mm = Vector3::Zero();  ///< where translation is told
  std::size_t likelihood_rows =
      3000;  ///< the densities are sought on at most this many rows, spread over the recording
};

struct SmoothedRow {
  bool valid = false;  ///< as the raw row: gaps stay gaps
  Transform<HeadFrame, Bow> head_from_bow;
  Matrix6 covariance = Matrix6::Zero();  ///< left perturbation
};

struct SmoothedMotion {
  std::vector<SmoothedRow> rows;  ///< one for each row of the session
  double rotation_density = 0, translation_density = 0;
  bool densities_given = false;
  /// Mean normalised innovation squared / 6: 1 where the rows' covariances and the model tell all.
  double innovation_ratio = 0;
};

/// Constant acceleration, white jerk; error state on the manifold, in the bow's own axes; each row weighs by
/// its covariance. Refused with kInput: fewer than 10 valid rows.
Result<SmoothedMotion> smooth_motion(const SessionMotion& session, const SmoothingOptions& options);

/// The session with the smoothed poses in place of the raw ones (head frame as the rig: H = identity), for
/// what reads sessions.
SessionMotion smoothed_session(const SessionMotion& session, const SmoothedMotion& smoothed);

}  // namespace gnathion
