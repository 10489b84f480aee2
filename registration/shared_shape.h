// Whether several scans of one body agree that it is not as its model.
//
// A body that is smoothly bent against its model leaves residuals that look like a scanner's own bulge, and
// no single scan tells the two apart. Noise is another in each scan; the bend is the same. Each fit estimates
// the same smooth deformations of the body (linear and quadratic in place); what the estimates have in common
// is held against how much they differ (an F ratio). How large the noise is taken to be cancels.
#pragma once

#include <vector>

#include "registration/patch_fit.h"

namespace gnathion {

/// Displacement fields u(p) of a body: 6 strains and 18 quadratic ones, in mm at `radius_mm` from the centre.
struct ShapeModes {
  static constexpr int kCount = 24;
  Vector3 centre_mm = Vector3::Zero();
  double radius_mm = 100.0;

  /// n·u of each mode at a point of the surface.
  Eigen::Matrix<double, kCount, 1> along(const Vector3& normal, const Vector3& p_mm) const;
  /// The same for all pairs, a column each.
  Eigen::MatrixXd along(const std::vector<PlanePair>& pairs) const;
};

struct SharedShape {
  double ratio = 0.0;    ///< of what is common to what differs, by their freedoms: about 1 if nothing is
  int freedom = 0;       ///< of what is common; 0: nothing could be said
  double bent_mm = 0.0;  ///< root mean square of the common deformation along the normals
};

/// One fit of several to the same surface, in whose frame the modes are.
struct ShapeFit {
  const PatchModel* patches = nullptr;
  const std::vector<PlanePair>* pairs = nullptr;
  Rigid3 target_from_source;
  ScoreRows rows;  ///< pose and scales, whose parts of the deformation tell nothing
};
/// A body's deformation as all fits to it have it: the modes' sizes and their covariance, with the poses of
/// all fits estimated along.
struct BodyShape {
  ShapeModes modes;
  Eigen::VectorXd sizes_mm;
  Eigen::MatrixXd covariance_mm2;
  double bent_mm = 0.0;  ///< root mean square along the normals of the first fit's points
  double ratio = 0.0;    ///< SharedShape's, by which it was found

  double along_mm(const Vector3& normal, const Vector3& p_mm) const {
    return modes.along(normal, p_mm).dot(sizes_mm);
  }
};
/// `sigma_mm`: how large modes may be. `taken_out`: what the pairs' residuals have been corrected by, may be
/// null.
BodyShape estimated_shape(const std::vector<ShapeFit>& fits, const ShapeModes& modes, double sigma_mm,
                          const BodyShape* taken_out);
/// At least two fits.
SharedShape shared_shape(const std::vector<ShapeFit>& fits, const ShapeModes& modes);

}  // namespace gnathion
