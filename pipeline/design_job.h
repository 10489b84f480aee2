// From files to a splint's folder: read, check, design, verify, write. What `gnathion design` does.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include <nlohmann/json_fwd.hpp>

#include "anatomy/realizability.h"
#include "core/progress.h"
#include "core/result.h"
#include "core/transform_io.h"
#include "design/splint.h"
#include "pipeline/check_job.h"

namespace gnathion {

struct DesignJob {
  std::filesystem::path maxilla, mandible, transform;
  std::filesystem::path occlusal_surface;  ///< of the arch that wears the splint; empty: its crowns
  Arch arch = Arch::kMaxilla;              ///< that wears the splint
  /// Excursions that must run free: motion.csv in the dental frame, or motion.mcap with `calibration` (empty:
  /// chain.json beside it); empty: none but those of the parameters.
  std::filesystem::path motion, calibration;
  KnowledgeFiles known;                  ///< joints and recorded motion that T_th is checked with
  std::vector<std::string> known_notes;  ///< what a user should know of them
  SplintEdits edits;                     ///< in Dental
  bool mandible_is_in_tp = false;        ///< the file has the mandible in TP already
  SplintParameters parameters;
  bool pictures = true;
  std::filesystem::path shown_folder;     ///< reports name inputs relative to it; empty: as given
  std::filesystem::path shown_transform;  ///< how reports name the transform's file; empty: as it is
};

/// Inputs as read, in Dental, mandible in MI.
struct DesignInputs {
  SplintInputs splint;
  MotionFile motion;
  std::vector<InputRecord> files;
};
Result<DesignInputs> read_design_inputs(const DesignJob& job);

struct DesignOutcome {
  Feasibility feasibility;
  std::optional<SplintDesign> design;            ///< absent when T_th is not realizable
  std::shared_ptr<const nlohmann::json> report;  ///< design.json
  bool accepted() const { return design && design->verdict == "pass"; }
};

/// Writes into `folder` (which exists): design.json, feasibility.json, and splint.stl with splint.3mf and
/// pictures, or splint.rejected.stl. A refusal is a value; errors are unreadable or invalid input.
Result<DesignOutcome> run_design(const DesignJob& job, const std::filesystem::path& folder,
                                 Progress& progress);

}  // namespace gnathion
