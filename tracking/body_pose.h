// Pose of a tagged body from all of its tags that all cameras of the rig see at one instant.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/camera_model.h"
#include "tracking/tag_detector.h"

namespace gnathion {

/// What each camera of the rig saw at one instant, in the rig's order of cameras.
using RigTags = std::vector<std::vector<TagObservation>>;

/// A scale that ought to be 1, from one frame: ln(scale) = gradient / information ± 1 / √information. Sums
/// over frames are the estimate over frames.
struct ScaleEvidence {
  double gradient = 0, information = 0;
  void add(const ScaleEvidence& e) { gradient += e.gradient, information += e.information; }
  double log_scale() const { return information > 0 ? gradient / information : 0; }
};

/// Where a body is, or why that is not known.
struct BodyPose {
  bool valid = false;
  std::string reason;       ///< empty when valid: "no tag seen", "1 tag, need 2", "residual 3.1 px", …
  Rigid3 camera_from_body;  ///< into the rig's frame
  Matrix6 covariance = Matrix6::Zero();  ///< left perturbation (rotation, translation), rad, mm
  double rms_px = 0;                     ///< per coordinate, over the corners used
  double residual_scale = 1;             ///< √(χ²/dof): 1 where the corners' covariances tell all
  int tags_seen = 0;                     ///< observations that carry an id of this body
  int tags_used = 0;
  std::vector<int> rejected_ids;            ///< seen, but at odds with the others
  std::vector<ScaleEvidence> focal_length;  ///< of each camera, against the rig's
  ScaleEvidence tag_size;                   ///< each tag about its own centre, against the body's file
};

struct BodyPoseOptions {
  int min_tags = 2;             ///< one tag alone has a planar ambiguity
  double max_rms_px = 1.0;      ///< above it the pose is not valid
  double outlier_factor = 4.0;  ///< a tag this many times worse than the median tag is rejected
  double outlier_min_px = 0.3;  ///< but never one whose RMS is below this
  /// A second minimum with a cost below this many times the first's is a doubt.
  double ambiguity_ratio = 2.0;
};

/// Robust start (planar PnP of single tags, judged by all the others; or `guess`), then Gauss–Newton on SE(3)
/// over reprojection errors whitened by the corners' covariances. `guess` is camera_from_body. Under a
/// rolling shutter the pose is that of the middle row's exposure and `velocity` (per second, left twist in
/// the rig's frame) tells where the body is when the other rows are exposed; without it the covariance is
/// widened.
BodyPose estimate_body_pose(const Rig& rig, const TaggedBody& body, const RigTags& tags,
                            const BodyPoseOptions& options, const std::optional<Rigid3>& guess = std::nullopt,
                            const std::optional<Vector6>& velocity = std::nullopt);

/// When the row of a pixel is exposed, after the middle row's exposure; 0 under a global shutter.
double after_capture_s(const RigCamera& camera, double row_px);

/// Corners of a tag as a camera sees them when its body is at `rig_from_body`; nothing where it faces away
/// (more than `max_tilt_deg` between its normal and the line of sight), lies behind the camera or leaves the
/// image.
std::optional<TagCorners> projected_tag(const RigCamera& camera, const BodyTag& tag,
                                        const Rigid3& rig_from_body, double max_tilt_deg = 78.0,
                                        const Vector6& velocity = Vector6::Zero());

}  // namespace gnathion
