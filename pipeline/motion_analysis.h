// `gnathion motion analyse`: a tracked motion read as clinicians read it, as numbers, tables and pictures.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/progress.h"
#include "core/result.h"
#include "tracking/analysis/jaw_analysis.h"
#include "tracking/plateaus.h"

namespace gnathion {

struct MotionAnalysisJob {
  std::filesystem::path motion;       ///< motion.mcap, or motion.csv in the dental frame
  std::filesystem::path calibration;  ///< chain.json; empty for a motion.csv
  std::filesystem::path landmarks;    ///< landmarks.toml; or both arches:
  std::filesystem::path maxilla, mandible;
  PlateauOptions plateaus;  ///< MI, where it is given
  JawAnalysisOptions options;
  bool pictures = true;
};

/// What was analysed, and what came out.
struct MotionAnalysis {
  JawRecording recording;
  JawAnalysis analysis;
};

/// landmarks.toml (docs/jaw-motion.md). Refused with kInput: an unknown key, a point that is not three
/// numbers, a plane whose points are missing.
Result<JawLandmarks> read_landmarks(const std::filesystem::path& path);
/// Incisal point, ends of the arch and occlusal plane of two arches in MI.
Result<JawLandmarks> landmarks_of_arches(const std::filesystem::path& maxilla,
                                         const std::filesystem::path& mandible);

Result<MotionAnalysis> analyse_motion(const MotionAnalysisJob& job, Progress& progress);
/// analysis.json, numbers.csv, paths.csv, chewing.csv, settings.csv and pictures/ into `folder`, which
/// exists.
Status write_motion_analysis(const MotionAnalysis& m, const MotionAnalysisJob& job,
                             const std::filesystem::path& folder);
Status draw_motion_analysis(const MotionAnalysis& m, const std::filesystem::path& folder);

nlohmann::json motion_analysis_json(const MotionAnalysis& m);
std::string motion_analysis_text(const MotionAnalysis& m);

}  // namespace gnathion
