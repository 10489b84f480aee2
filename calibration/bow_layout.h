// The layout of a body's tags as the adjustment knows it, and its least-squares problem. Private to the bow's
// calibration.
#pragma once

#include <vector>

#include "calibration/bow_geometry.h"

namespace gnathion {

/// A flat rectangle on the body: x along its lower edge, y up, z out of its front.
struct LayoutTag {
  int id = 0;
  Rigid3 body_from_tag;
  double nominal_side_mm = 0;
  double log_width = 0, log_height = 0;  ///< of this tag against the common factor
};

struct TagLayout {
  std::vector<LayoutTag> tags;
  double log_scale = 0;  ///< common factor on the nominal sides

  /// Corner k in the tag's own plane, z = 0.
  Vector3 corner_in_tag(std::size_t tag, std::size_t k) const;
  Vector3 corner(std::size_t tag, std::size_t k) const {
    return tags[tag].body_from_tag * corner_in_tag(tag, k);
  }
};

/// From corners: each tag's centre, plane and mean side.
TagLayout layout_of(const TaggedBody& body);

/// One tag in one camera at one instant, by index.
struct LayoutObservation {
  int view = 0, camera = 0, tag = 0;
  Eigen::Matrix<double, 8, 1> corners_px;
  Eigen::Matrix<double, 8, 8> whitening;  ///< lower triangular W with WᵀW = covariance⁻¹
  bool used = true;
};

/// Whitened residual with its derivatives; nothing when a corner is not before the camera.
struct ObservationTerms {
  Eigen::Matrix<double, 8, 1> residual;  ///< W (observed − projected) with the sign of projected − observed
  Eigen::Matrix<double, 8, 6> by_view, by_tag;  ///< left perturbations of rig_from_body, body_from_tag
  Eigen::Matrix<double, 8, 2> by_size;          ///< log_width, log_height
  Eigen::Matrix<double, 8, 1> by_scale;         ///< log_scale
  Eigen::Matrix<double, 8, 1> by_focal;         ///< relative change of fx and fy
};
bool evaluate_observation(const RigCamera& camera, const LayoutObservation& o, const TagLayout& layout,
                          const Rigid3& rig_from_body, ObservationTerms& terms);

/// What the adjustment moves.
struct LayoutState {
  TagLayout layout;
  std::vector<Rigid3> rig_from_body;  ///< per view
};

struct LayoutPrior {
  double log_scale = 0, log_scale_sigma = 0.02;
  bool scale_fixed = false;
  double size_sigma = 0.005;  ///< of log_width and log_height
};

/// Ceres, Huber loss on each tag's eight whitened residuals (`huber`: their norm). View 0 is held: the gauge
/// is chosen afterwards.
Status adjust_layout(const std::vector<RigCamera>& cameras,
                     const std::vector<LayoutObservation>& observations, const LayoutPrior& prior,
                     double huber, LayoutState& state);

/// Pose of a view from the observations given (Gauss–Newton, layout fixed); nothing when it does not settle.
std::optional<Rigid3> fit_view(const std::vector<RigCamera>& cameras, const TagLayout& layout,
                               const std::vector<const LayoutObservation*>& observations,
                               const Rigid3& start);

/// Linearised at the solution, the views eliminated (Schur), in the gauge that keeps the best rigid fit of
/// the corners to `nominal` the identity. Corners run tag by tag, x0 y0 z0 … z3.
struct LayoutCovariance {
  Eigen::MatrixXd total;  ///< of all corners, mm²
  Eigen::MatrixXd shape;  ///< with the scale held
  double log_scale_sigma = 0;
  Eigen::VectorXd corner_by_focal_mm;  ///< shift of the corners by a relative change of the focal length
};
Result<LayoutCovariance> layout_covariance(const std::vector<RigCamera>& cameras,
                                           const std::vector<LayoutObservation>& observations,
                                           const LayoutPrior& prior, const LayoutState& state,
                                           const std::vector<Vector3>& nominal_corners_mm);

/// Rotation and translation that bring `points` onto `targets` (least squares; Kabsch 1976).
Rigid3 best_rigid_fit(const std::vector<Vector3>& points, const std::vector<Vector3>& targets,
                      const std::vector<double>& weights = {});

}  // namespace gnathion
