// From a recording to the jaw's motion and its two positions.
#pragma once

#include <filesystem>
#include <optional>

#include <nlohmann/json_fwd.hpp>

#include "acquisition/pose_recording.h"
#include "calibration/chain.h"
#include "core/progress.h"
#include "core/result.h"
#include "tracking/electromagnetic.h"
#include "tracking/motion_file.h"
#include "tracking/plateaus.h"
#include "tracking/session_motion.h"
#include "tracking/smoothing.h"

namespace gnathion {

/// Replays a recording through the tracker.
Result<SessionMotion> track_recording(const std::filesystem::path& recording, const Rig& rig,
                                      Progress& progress);

/// electromagnetic.toml (docs/formats.md). Refused with kInput: an unknown key, a value out of range, a mount
/// whose file is not there.
Result<ElectromagneticSetup> read_electromagnetic(const std::filesystem::path& path);
/// The same from poses that a tracker recorded.
Result<ElectromagneticMotion> track_electromagnetic(const std::filesystem::path& recording,
                                                    const ElectromagneticSetup& setup);

/// The mount's error is shared by all rows, and acts as one of T_D. It travels with the session as an event
/// of kind "mount"; mount_covariance() gives it back, zero where there is none.
void add_mount_covariance(const Matrix6& covariance, SessionMotion* session);
Matrix6 mount_covariance(const SessionMotion& session);

/// sensor.json: {"kind":"sensor","bow_from_sensor":{"matrix","covariance"},…} of `gnathion calibrate sensor`.
struct SensorCalibrationJob {
  std::filesystem::path recording;  ///< with the sensor's poses on `stream`
  std::string stream;
  std::filesystem::path motion;  ///< motion.mcap of the same time, bow seen by cameras
  std::filesystem::path points;  ///< or points.csv: x,y,z of the bow's file, x,y,z seen by the sensor
  double sigma_mm = 0.5, sigma_deg = 0.1;
};
Result<SensorCalibration> run_sensor_calibration(const SensorCalibrationJob& job);
nlohmann::json sensor_json(const SensorCalibration& c);

/// motion.mcap and back: nothing that plateaus and jaw_motion need is lost.
/// With `smoothed`, that is a channel of its own, "bow_smoothed" in "head_frame".
PoseRecording to_pose_recording(const SessionMotion& session, const SmoothedMotion* smoothed = nullptr);
Result<SessionMotion> to_session_motion(const PoseRecording& poses, const std::string& where);

}  // namespace gnathion
