// Bow and head frame from frame to frame: predicts, follows each tag in its own window, and searches images
// only where a body is lost.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "core/camera_model.h"
#include "core/image.h"
#include "core/time.h"
#include "tracking/body_pose.h"
#include "tracking/tag_detector.h"

namespace gnathion {

struct BodyTrackerOptions {
  TagDetectorOptions detector;
  BodyPoseOptions pose;
  int search_pause_frames = 5;    ///< while a body stays lost, whole frames are searched this often
  double max_prediction_s = 0.1;  ///< an older pose predicts nothing
  /// While a body is lost, each frame is searched in this many tiles of a twentieth of the image, the nearest
  /// to where it was last seen (or the middle) first: no frame takes much longer than another (live). 0:
  /// whole frames (recordings).
  int search_tiles = 0;
  /// Tags that were not seen in the last frame and should be visible: so many of each body are looked for in
  /// a frame, in turn.
  int retries_per_frame = 2;
};

struct BodyPoses {
  BodyPose bow, head;
  bool searched = false;            ///< a whole frame, or tiles of it, was searched
  std::vector<int> ids_seen_twice;  ///< found at two places of one image by the search, both without doubt
  std::vector<int> foreign_ids;     ///< found by the search, on neither body
  RigTags tags;                     ///< all that was seen, where a body is lost after a search
};

/// Not thread-safe. Results depend only on the frames since construction or reset().
class BodyTracker {
 public:
  static Result<std::unique_ptr<BodyTracker>> create(const Rig& rig, const BodyTrackerOptions& options);
  ~BodyTracker();
  /// Forgets the past; the next frame is searched whole.
  void reset();
  /// One instant, `capture` in the middle of the exposure (of the middle row under a rolling shutter).
  /// `images` in the rig's order of cameras; null where a camera's frame is missing.
  BodyPoses next(HostTime capture, const std::vector<const Image8*>& images);

 private:
  struct Impl;
  explicit BodyTracker(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace gnathion
