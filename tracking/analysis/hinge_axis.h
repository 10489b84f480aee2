// The axis that the mandible turns about while it opens a little: least squares over opening arcs.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/rigid.h"

namespace gnathion {

/// A fixed axis; point_mm is where it meets the plane through `centre_mm` normal to `normal` (the midsagittal
/// plane).
struct HingeAxis {
  Vector3 point_mm = Vector3::Zero();
  Vector3 direction = Vector3::UnitX();  ///< unit, towards the patient's left: positive angles open
  double misfit_mm = 0;    ///< RMS distance of points of the axis (±55 mm) from where the fit has them
  double expected_mm = 0;  ///< what the rows' covariances alone give
  double migration_mm =
      0;  ///< distance of the axes fitted to the first and second half of the arc, at ±55 mm
  double migration_sigma_mm = 0;  ///< what noise alone gives
  double chi2_per_dof = 1;
  double largest_deg = 0;         ///< largest rotation used
  double start_s = 0, end_s = 0;  ///< of the arcs, from the first to the last; filled in by the analysis
  int rows = 0;
};

struct HingeArc {
  std::vector<Rigid3> motions;      ///< of the mandible from MI, dental frame
  std::vector<Matrix6> covariance;  ///< left perturbation
};

/// Maximum likelihood over axis and one angle a row. `plane_point_mm`, `left`: the midsagittal plane and
/// where left is. Nothing where the arc has fewer than 8 rows or turns less than 4°.
std::optional<HingeAxis> fit_hinge_axis(const HingeArc& arc, const Vector3& plane_point_mm,
                                        const Vector3& left, bool with_migration = true);

}  // namespace gnathion
