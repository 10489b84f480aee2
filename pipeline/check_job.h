// `gnathion check`: what is known of a patient, and whether T_th can be realized with it.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "anatomy/realizability.h"
#include "core/progress.h"
#include "core/transform_io.h"
#include "pipeline/cbct_steps.h"
#include "tracking/motion_file.h"

namespace gnathion {

/// What is known of a patient beside the jaws.
struct KnowledgeFiles {
  /// Joints: a DICOM folder, a NIfTI or NRRD file, or a folder of meshes (docs/cbct.md); empty: none.
  std::filesystem::path cbct;
  std::filesystem::path
      cbct_pose;  ///< cbct_from_dental.json of an earlier registration; empty: by the crowns
  CbctOptions cbct_options;
  std::filesystem::path motion, calibration;  ///< the patient's own recording; empty: none
  std::vector<std::string> paths() const;     ///< of all that are given
};
/// The files that tell what a mandible can do.
struct PatientFiles : KnowledgeFiles {
  std::filesystem::path maxilla, mandible;  ///< in MI, one frame
  std::vector<std::string> paths() const;   ///< of all that are given
};

struct Patient {
  TriangleMesh maxilla, mandible_mi;
  RealizabilityChecker checker;
  std::optional<JawMotion> motion;
  std::vector<std::string> notes;  ///< what a user should know about joints and recording
};
/// Reads and makes ready; joints that cannot be found are an error, as an unreadable jaw is.
Result<Patient> read_patient(const PatientFiles& files, const RealizabilityLimits& limits,
                             Progress& progress);
/// The files' options with the registration of `cbct_pose` in them, where there is one.
Result<CbctOptions> cbct_options_of(const KnowledgeFiles& files);
/// Joints and recording for a checker that exists already.
Status add_knowledge(const KnowledgeFiles& files, const TriangleMesh& maxilla,
                     const TriangleMesh& mandible_mi, RealizabilityChecker* checker,
                     std::vector<std::string>* notes, Progress& progress);
/// Joints that were found already; refused (kInput) where they cannot be this patient's in MI. `where` is named.
Status add_joints(const Joints& joints, const std::filesystem::path& where, RealizabilityChecker* checker,
                  std::vector<std::string>* notes);

struct CheckOutcome {
  Feasibility feasibility;
  std::string text;  ///< for people
};
Result<CheckOutcome> run_check(const PatientFiles& files, const std::filesystem::path& transform,
                               Progress& progress);
std::string feasibility_text(const Feasibility& feasibility);

}  // namespace gnathion
