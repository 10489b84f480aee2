// The CR/MI discrepancy: where the mandible goes from maximal intercuspation (MI) to centric relation (CR),
// as a diagnostic quantity with its error.
#pragma once

#include <string>
#include <vector>

#include "core/result.h"
#include "core/transform.h"
#include "occlusion/arch.h"

namespace gnathion {

/// Where the mandible stands in one recording: its motion from the scanned MI, with covariance (left,
/// Dental).
using MandiblePose = Uncertain<Motion<Dental>>;

/// Mean of repeated recordings of one position.
struct RepeatedPose {
  MandiblePose
      mean;  ///< covariance of the mean: what the recordings say of themselves, or their scatter if larger
  std::size_t recordings = 0;
  double scatter_deg = 0.0, scatter_mm = 0.0;  ///< 1σ over recordings, at `about_mm`; 0 for one
};
/// Unweighted mean on SE(3), so that a recording that overrates itself does not decide; `about_mm` is where
/// the scatter is told. The scatter needs two recordings.
RepeatedPose mean_pose(const std::vector<MandiblePose>& recordings, const Vector3& about_mm);

struct Landmark {
  std::string name;
  Vector3 at_mm = Vector3::Zero();  ///< in MI
};

/// How one landmark of the mandible moves from MI to CR.
struct LandmarkShift {
  Landmark landmark;
  Vector3 displacement_mm = Vector3::Zero();  ///< Dental
  Vector3 in_arch_mm = Vector3::Zero();       ///< the same: to the patient's left, to the front, up
  Vector3 in_arch95_mm = Vector3::Zero();     ///< half widths of their 95 % intervals
  double length_mm = 0.0;
  double bound95_mm = 0.0;  ///< radius about the displacement's end that holds 95 % of the error
};

struct Discrepancy {
  Uncertain<Motion<Dental>> cr_from_mi;  ///< CR = cr_from_mi · MI
  RepeatedPose mi, cr;
  double alpha_deg = 0.0, alpha95_deg = 0.0;  ///< with the half width of its 95 % interval
  std::vector<LandmarkShift> landmarks;
  double chi2 = 0.0;     ///< of no discrepancy at all, 6 degrees of freedom
  double p_value = 1.0;  ///< below 0.05: more than the error of the recordings
};

/// Errors (kInput): no recording, a covariance that is none.
Result<Discrepancy> find_discrepancy(const std::vector<MandiblePose>& mi, const std::vector<MandiblePose>& cr,
                                     const std::vector<Landmark>& landmarks, const ArchFrame& arch);

/// P(χ² > x) for an even number of degrees of freedom.
double chi_square_upper_tail(double x, int even_degrees_of_freedom);

}  // namespace gnathion
