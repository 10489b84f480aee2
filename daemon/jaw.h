// The jaw, live: from the poses of bow and head frame at one instant, and MI. Pure.
#pragma once

#include <optional>
#include <string>

#include "core/transform.h"
#include "daemon/live_types.h"
#include "tracking/session_motion.h"

namespace gnathion::daemon {

/// Without T_D the jaw is the bow in the head frame. With it, the mandible's motion from MI in the dental
/// frame (DESIGN: T_th = T_D⁻¹ · (H0⁻¹M0)⁻¹ · (H1⁻¹M1) · T_D, of this instant instead of TP). MI is where the
/// bow was at the last "MI" mark or pedal press, or at the first valid pose until there is one.
class JawFollower {
 public:
  explicit JawFollower(std::optional<Transform<Bow, Dental>> bow_from_dental)
      : bow_from_dental_(std::move(bow_from_dental)) {}
  /// The next valid pose stands for MI.
  void mi_begins(const std::string& what) { pending_ = what; }
  LivePose next(const MotionRow& row);

 private:
  struct AtMi {
    Transform<HeadFrame, Bow> head_from_bow;
    Matrix6 covariance;
    std::string what;
  };
  std::optional<Transform<Bow, Dental>> bow_from_dental_;
  std::optional<AtMi> at_mi_;
  std::optional<std::string> pending_;
};

}  // namespace gnathion::daemon
