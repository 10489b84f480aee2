// The least-squares core of a body's pose: observed corners of its tags against projected ones.
#pragma once

#include <optional>
#include <vector>

#include "tracking/body_pose.h"

namespace gnathion {

using Vector8 = Eigen::Matrix<double, 8, 1>;

/// One observed tag with its place on the body.
struct Sighting {
  const RigCamera* camera = nullptr;
  std::size_t camera_index = 0;
  Rigid3 camera_from_rig;
  const BodyTag* tag = nullptr;
  const TagObservation* seen = nullptr;
  Matrix8 whitener = Matrix8::Zero();  ///< L⁻¹ of the corners' covariance L·Lᵀ
  Eigen::Vector4d after_capture_s =
      Eigen::Vector4d::Zero();  ///< when a rolling shutter exposed each corner's row
  double area_px2 = 0;
  bool used = true;
  double weight = 1;  ///< below 1 where the tag is at odds with the others
};

/// All observations of the body's tags.
std::vector<Sighting> sightings_of(const Rig& rig, const TaggedBody& body, const RigTags& tags);

/// Where a point at `p_rig_mm` in the middle of the exposure is `after_s` later, to second order.
Vector3 moved_point(const Vector3& p_rig_mm, const Vector6& velocity, double after_s);

/// RMS of the sighting's residuals a coordinate; infinite when a corner lies behind the camera.
double rms_px(const Sighting& s, const Rigid3& rig_from_body, const Vector6& velocity);

struct BodyFit {
  Rigid3 pose;
  Matrix6 information = Matrix6::Zero();
  double chi2 = 0, squares_px2 = 0, weight = 0;
  int tags = 0;
};

enum class Loss : std::uint8_t {
  kCauchyWide,  ///< of a tag's RMS against 2 px: far from the solution
  kCauchy,      ///< against 0.6 px
  kBounded,     ///< whitened; the influence of a tag far beyond the median one is bounded
};

/// Gauss–Newton on SE(3) over the sightings in use. `velocity`: of the body, per second, left twist in the
/// rig's frame; it matters under a rolling shutter only.
std::optional<BodyFit> fit_body(std::vector<Sighting>& sightings, const Rigid3& start,
                                const Vector6& velocity, Loss loss, int iterations);

/// What the residuals say about focal lengths and about the tags' size, the pose being free.
void add_scale_evidence(const std::vector<Sighting>& sightings, const BodyFit& fit, const Vector6& velocity,
                        BodyPose* pose);

double median(std::vector<double> values);

}  // namespace gnathion
