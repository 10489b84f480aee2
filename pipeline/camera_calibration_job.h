// Cameras calibrated from images or a recording of a board: what `gnathion calibrate camera` and `calibrate
// rig` do.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "calibration/rig_calibration.h"
#include "core/camera_model.h"
#include "core/progress.h"

namespace gnathion {

struct CalibrationCamera {
  std::string name;              ///< of the camera; with a recording also its stream
  std::filesystem::path images;  ///< folder; empty: from the recording
};

struct CameraCalibrationJob {
  std::vector<CalibrationCamera> cameras;  ///< one: its intrinsics; more: a rig
  std::filesystem::path recording;
  CalibrationBoard board;
  CameraCalibrationOptions options;
  bool pair_by_time = false;      ///< images whose names are times in ns; otherwise by name
  double same_instant_s = 0.002;  ///< frames of a recording, or images by time
  int max_frames = 120;           ///< taken evenly from a recording
  std::string bow, head_frame;    ///< file names for the RIG.toml; empty: left to be filled in
};

/// An image in which the board was not found.
struct NotFound {
  std::string camera, image, reason;
};

struct CameraCalibrationOutput {
  RigCalibration rig;  ///< one camera: only `cameras[0].camera` counts
  std::vector<NotFound> not_found;
};

Result<CameraCalibrationOutput> run_camera_calibration(const CameraCalibrationJob& job, Progress& progress);

nlohmann::json camera_calibration_json(const CameraCalibrationJob& job, const CameraCalibrationOutput& out);
std::string camera_calibration_text(const CameraCalibrationOutput& out);
/// RIG.toml; complete where the job names bow and head frame.
std::string calibration_rig_toml(const CameraCalibrationJob& job, const CameraCalibrationOutput& out);
/// Corners of all views with their residuals over the image, and what is covered: PNG bytes.
Result<std::string> camera_calibration_picture(const CameraCalibrationOutput& out);

}  // namespace gnathion
