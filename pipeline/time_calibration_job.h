// The constant offset between two streams of poses in recordings: what `gnathion calibrate time` does.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "acquisition/temporal_calibration.h"
#include "core/progress.h"

namespace gnathion {

struct TimeCalibrationJob {
  std::vector<std::string> files;  ///< recordings, or motion.mcap of `gnathion track`
  std::vector<std::string>
      streams;  ///< two: "polhemus", "polhemus/sensor_1", or a body of motion.mcap: "bow"
  TemporalCalibrationOptions options;
};

struct TimeCalibrationResult {
  TemporalCalibration offset;
  std::size_t samples[2] = {0, 0};  ///< valid poses of each stream
};

/// Refuses streams that are not there (and says which are), and what calibrate_time_offset refuses.
Result<TimeCalibrationResult> run_time_calibration(const TimeCalibrationJob& job, Progress& progress);
nlohmann::json time_calibration_json(const TimeCalibrationJob& job, const TimeCalibrationResult& result);
std::string time_calibration_text(const TimeCalibrationJob& job, const TimeCalibrationResult& result);

/// A recording again, with the capture times of the calibration's second stream moved onto the first's clock.
struct TimeShiftJob {
  std::filesystem::path recording, time, out;  ///< time.json of run_time_calibration
};
/// Samples moved. The calibration is attached, and a second shift of the stream refused.
Result<std::size_t> shift_recording(const TimeShiftJob& job, Progress& progress);

}  // namespace gnathion
