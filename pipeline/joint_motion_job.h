// `gnathion joints motion`: condyles and fossae in T_th and along a recorded motion.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/check_job.h"

namespace gnathion {

/// One joint at one instant. Points in Dental.
struct JointRow {
  double time_s = 0.0;
  JointSpace space;
  Vector3 lateral_pole_mm = Vector3::Zero(), medial_pole_mm = Vector3::Zero(), centre_mm = Vector3::Zero();
};

/// One joint along the way.
struct JointMotion {
  Side side = Side::kLeft;
  JointRow mi;
  std::optional<JointRow> tp;
  std::vector<JointRow> rows;  ///< of the recording's valid instants
};

struct JointMotions {
  std::vector<JointMotion> joints;
  std::string source;
  std::size_t invalid_rows = 0;  ///< of the recording
  double joint_space_mm = 1.0;   ///< limit below which a row counts as narrow
  std::vector<std::string> notes;
};

/// On all cores. `therapeutic` and patient.motion: either may be missing, not both.
Result<JointMotions> follow_joints(const Patient& patient, const std::optional<Motion<Dental>>& therapeutic,
                                   Progress& progress);
/// joints.json, joints.csv, map_left.ply, map_right.ply (the condyle coloured by its distance in T_th, else
/// at the narrowest instant) and pictures/ into `folder`, which exists.
Status write_joint_motions(const JointMotions& motions, const Patient& patient,
                           const std::optional<Motion<Dental>>& therapeutic,
                           const std::filesystem::path& folder);
nlohmann::json joint_motions_json(const JointMotions& motions, const ArchFrame& arch);
std::string joint_motions_text(const JointMotions& motions);
Status draw_joint_motions(const JointMotions& motions, const Patient& patient,
                          const std::optional<Motion<Dental>>& therapeutic,
                          const std::filesystem::path& folder);

}  // namespace gnathion
