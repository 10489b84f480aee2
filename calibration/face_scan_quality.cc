#include "calibration/face_scan_quality.h"

#include <fmt/format.h>

#include <cmath>

#include "core/check.h"

namespace gnathion {

FaceScanQuality face_scan_quality(const ResidualNoise& noise, const Matrix6& covariance,
                                  const std::vector<Vector3>& teeth_in_bow_mm) {
  GNATHION_CHECK(!teeth_in_bow_mm.empty());
  FaceScanQuality quality;
  quality.deviation_mm = std::hypot(noise.white_sigma_mm(), noise.correlated_sigma_mm());
  double sum = 0;
  for (const Vector3& p : teeth_in_bow_mm) sum += point_covariance(covariance, p).trace();
  quality.at_teeth_mm = std::sqrt(sum / static_cast<double>(teeth_in_bow_mm.size()));
  return quality;
}

std::optional<std::string> too_coarse(const std::string& scan_name, const FaceScanQuality& quality) {
  if (quality.at_teeth_mm <= kLargestFaceScanError_mm) return std::nullopt;  // false for NaN
  return fmt::format(
      "{} too coarse for T_F: deviation {:.2f} mm gives {:.2f} mm at the teeth, {:.2f} allowed", scan_name,
      quality.deviation_mm, quality.at_teeth_mm, kLargestFaceScanError_mm);
}

}  // namespace gnathion
