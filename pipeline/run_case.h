// The main job: everything a case folder asks for, in order, each step redone only when something changed.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "calibration/displacement.h"
#include "core/progress.h"
#include "core/result.h"
#include "core/time.h"
#include "pipeline/case_file.h"
#include "pipeline/case_steps.h"
#include "pipeline/motion_steps.h"
#include "pipeline/therapeutic_steps.h"

namespace gnathion {

/// Where T_th of a case comes from; the first that case.toml gives.
enum class PositionRoute {
  kGiven,     ///< [position] transform
  kMeasured,  ///< [session] recording: camera, and face scans where there are any
  kScans      ///< intraoral scans in TP
};

/// What the design step wrote, made now or before.
struct CaseDesign {
  std::shared_ptr<const nlohmann::json> report;       ///< design.json
  std::shared_ptr<const nlohmann::json> feasibility;  ///< feasibility.json
  bool accepted() const;
};

/// All that was found on the way; the files lie in CASE/results.
struct CaseResults {
  std::string case_id;
  PositionRoute route = PositionRoute::kMeasured;
  // Of a measured position alone.
  SessionMotion session;
  Chain chain;
  CameraRoute camera;
  std::optional<TherapeuticEstimate> faces;
  std::optional<RouteComparison> comparison;
  JawMotion jaw_motion;
  std::vector<std::string> frame_notes;  ///< what the graph of frames found odd, one line each

  TherapeuticEstimate therapeutic;              ///< fused, or of the one route there is
  bool covariance_known = true;                 ///< else the covariance is zero and means nothing
  std::vector<LandmarkDisplacement> landmarks;  ///< incisal point, molars, estimated condyles
  std::vector<std::string> landmark_names;
  ScrewAxis screw;
  CaseDesign design;
  std::vector<StepOutcome> steps;  ///< which were reused, and why others were redone
};

struct RunOptions {
  SplintParameters parameters;
  SplintEdits edits;
  bool force = false;        ///< redo every step, replace a results folder that no run made
  bool accept_slip = false;  ///< go on although MI does not close
  Clock* clock = nullptr;    ///< of the times in results; null: the system's
};

/// Steps: replay and track, solve the chain, average MI and TP, T_th by both routes, compare and fuse, check,
/// design, draw. Writes CASE/results: motion.mcap, tracking.json, motion.csv, chain.json, T_th_camera.json,
/// T_th_faces.json, T_th.json, displacement.json, error_map.ply, cbct.json and joints/ (of a CBCT),
/// frames.json, feasibility.json, design.json, splint.stl, splint.3mf, pictures/, report.html,
/// provenance.json. A T_th that cannot be realized is a value (CaseResults::design), not an error. Killed at
/// any moment, the next call goes on with the step that was under way; after an error results/ is as it was.
Result<CaseResults> run_case(const CaseFile& files, const RunOptions& options, Progress& progress);

}  // namespace gnathion
