// Whether a face scan is fine enough for T_F.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/rigid.h"
#include "registration/residual_noise.h"

namespace gnathion {

/// How noisy a face scan is on the bow, whose true surface is known, and what that does to T_F where it
/// matters.
struct FaceScanQuality {
  double deviation_mm = 0;  ///< 1σ along the normal against the bow's CAD surface, correlated part included
  double at_teeth_mm = 0;   ///< predicted RMS displacement of the lower teeth by the error of bow_from_face
};

/// T is asked to hold 0.10 mm RMS at the teeth; a T_F that takes all of it leaves nothing for T_D.
inline constexpr double kLargestFaceScanError_mm = 0.10;

/// `noise` of the bow's registration in the scan; `covariance` of bow_from_face (left perturbation), which
/// has the scan's scale error and correlated noise in it; `teeth_in_bow_mm` not empty.
FaceScanQuality face_scan_quality(const ResidualNoise& noise, const Matrix6& covariance,
                                  const std::vector<Vector3>& teeth_in_bow_mm);

/// "face scan in MI too coarse for T_F: deviation 0.80 mm gives 0.30 mm at the teeth, 0.10 allowed", or
/// nothing.
std::optional<std::string> too_coarse(const std::string& scan_name, const FaceScanQuality& quality);

}  // namespace gnathion
