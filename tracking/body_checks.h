// What a session's frames tell about the files they are read with: a rig of other cameras, tags of another
// size, a lens that refocuses, another bow in view, mirrored pictures, a bow upside down.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "core/camera_model.h"
#include "core/image.h"
#include "core/result.h"
#include "tracking/body_tracker.h"

namespace gnathion {

/// Gathered frame by frame, by pieces of the session; pieces are merged in their order.
class SessionEvidence {
 public:
  /// `keep_pictures`: of a few frames without tags, to find out why. For the first pieces of a session.
  explicit SessionEvidence(std::size_t cameras, bool keep_pictures = true)
      : keep_pictures_(keep_pictures), focal_(cameras) {}

  void add(const BodyPoses& poses, const std::vector<const Image8*>& images);
  /// Takes the later piece's evidence.
  void merge(const SessionEvidence& later);

  /// The reason why the session must not be used, or nothing said. `valid` counts the rows with both poses.
  Status refusal(const Rig& rig, std::size_t valid, const std::string& usual_reason) const;
  /// What a user should know although the poses stand.
  std::vector<std::string> warnings(const Rig& rig) const;

 private:
  struct Sample {
    RigTags tags;
    std::vector<Image8> images;  ///< only where no tag was seen
  };

  Status refuse_strangers() const;
  Status refuse_scales(const Rig& rig) const;
  Status refuse_upside_down(const Rig& rig) const;
  Status explain_failure(const Rig& rig) const;

  bool keep_pictures_;
  std::map<int, int> frames_with_twice_;           ///< id → searched frames that show it twice
  std::map<int, int> foreign_;                     ///< id of neither body → searched frames
  std::vector<std::vector<ScaleEvidence>> focal_;  ///< per camera and piece of the session
  ScaleEvidence size_[2];                          ///< bow, head frame
  Matrix3 head_from_bow_sum_ = Matrix3::Zero();
  std::vector<Sample> failures_;  ///< a few frames without both poses
};

}  // namespace gnathion
