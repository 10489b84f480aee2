// Poses over time (motion.mcap) as a source of samples, and whether a file is one.
#pragma once

#include <filesystem>
#include <memory>

#include "acquisition/pose_recording.h"
#include "core/source.h"

namespace gnathion {

/// Told by its first message; false also for what cannot be read.
bool is_pose_recording(const std::filesystem::path& path);
/// One PoseSample for every row, valid or not, given in "camera", merged by time; then the events among them.
/// Covariance, RMS and tags of the rows are not part of a sample.
std::unique_ptr<Source> make_pose_source(PoseRecording poses);

/// A session's recording or a motion's, whichever the file is.
Result<std::unique_ptr<Source>> open_any_recording(const std::filesystem::path& path);

}  // namespace gnathion
