// The main job: a recorded session and its scans become a splint and a report.
#pragma once

#include <filesystem>
#include <optional>

#include "calibration/displacement.h"
#include "core/progress.h"
#include "core/result.h"
#include "pipeline/case_file.h"
#include "pipeline/design_job.h"
#include "pipeline/motion_steps.h"
#include "pipeline/therapeutic_steps.h"

namespace gnathion {

/// All that was found on the way; the files lie in CASE/results.
struct CaseResults {
  SessionMotion session;
  Chain chain;
  CameraRoute camera;
  std::optional<TherapeuticEstimate> faces;
  std::optional<RouteComparison> comparison;
  TherapeuticEstimate therapeutic;              ///< fused, or of the one route there is
  std::vector<LandmarkDisplacement> landmarks;  ///< incisal point, molars, estimated condyles
  std::vector<std::string> landmark_names;
  ScrewAxis screw;
  std::vector<std::string> frame_notes;  ///< what the graph of frames found odd, one line each
  JawMotion jaw_motion;
  DesignOutcome design;
};

struct RunOptions {
  SplintParameters parameters;
  SplintEdits edits;
  bool force = false;        ///< replace CASE/results
  bool accept_slip = false;  ///< go on although MI does not close
};

/// Steps: replay and track, average MI and TP, solve the chain, T_th by both routes, compare and fuse, check,
/// design, draw. Writes CASE/results: motion.mcap, motion.csv, chain.json, T_th_camera.json, T_th_faces.json,
/// T_th.json, displacement.json, error_map.ply, frames.json, feasibility.json, design.json, splint.stl,
/// splint.3mf, pictures/. A T_th that cannot be realized is a value (CaseResults::design), not an error.
Result<CaseResults> run_case(const CaseFile& files, const RunOptions& options, Progress& progress);

}  // namespace gnathion
