// From a recording to the jaw's motion and its two positions.
#pragma once

#include <filesystem>
#include <optional>

#include "acquisition/pose_recording.h"
#include "calibration/chain.h"
#include "core/progress.h"
#include "core/result.h"
#include "tracking/motion_file.h"
#include "tracking/plateaus.h"
#include "tracking/session_motion.h"

namespace gnathion {

/// Replays a recording through the tracker.
Result<SessionMotion> track_recording(const std::filesystem::path& recording, const Rig& rig,
                                      Progress& progress);

/// motion.mcap and back: nothing that plateaus and jaw_motion need is lost.
PoseRecording to_pose_recording(const SessionMotion& session);
Result<SessionMotion> to_session_motion(const PoseRecording& poses, const std::string& where);

}  // namespace gnathion
