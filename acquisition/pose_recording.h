// Poses over time as MCAP: what `gnathion track` writes and `gnathion transform motion` reads.
//
// Topics: "/<body>" foxglove.FrameTransform (valid poses only), "/<body>/status" gnathion.v1.PoseStatus
// (every frame, with the reason where a pose is not valid), "/pedal" gnathion.v1.Event.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/result.h"
#include "core/rigid.h"
#include "core/sample.h"

namespace gnathion {

/// One body in one camera frame.
struct PoseRecord {
  std::uint32_t sequence = 0;
  HostTime capture;
  bool valid = false;
  std::string reason;       ///< why not valid
  Rigid3 camera_from_body;  ///< mm; from the frame that `parent` names
  std::string parent = "camera";
  Matrix6 covariance = Matrix6::Zero();
  double rms_px = 0;
  int tags = 0;
};

struct PoseRecording {
  std::map<std::string, std::vector<PoseRecord>> bodies;  ///< "bow", "head_frame"; one row per camera frame
  // "bow_smoothed", in parent "head_frame": the smoothed motion, a second channel beside the raw one.
  std::vector<EventSample> events;
  HostTime start;  ///< time 0 of the session
};

/// Whole or not at all.
Status write_poses(const std::filesystem::path& path, const PoseRecording& poses,
                   const std::map<std::string, std::string>& attachments);
/// Refuses what is not such a file, a file that was cut off, poses without their status.
Result<PoseRecording> read_poses(const std::filesystem::path& path);

}  // namespace gnathion
