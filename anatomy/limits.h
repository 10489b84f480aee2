// The limits of realizability: one table, each with its source.
#pragma once

#include <string>
#include <vector>

namespace gnathion {

/// What a failed constraint does to the verdict.
enum class Severity { kInforms, kApertures, kBlocks };
const char* severity_name(Severity severity);  ///< "informs", "apertures", "blocks"

/// Displacements are told in the arch's directions, relative to MI. Sources: limit_table().
struct RealizabilityLimits {
  // Room for the splint.
  double wall_mm = 1.0;               ///< clearance where a full wall can stand
  double aperture_mm = 0.5;           ///< with less room than this an aperture opens
  double overlap_beyond_mi_mm = 0.1;  ///< overlap accepted beyond what MI itself shows by computation
  // Rotation of the mandible.
  double opening_deg = 35.0, closing_deg = 3.0;  ///< about the transverse axis, both ways
  double yaw_deg = 8.0;                          ///< about the occlusal normal
  double roll_deg = 5.0;                         ///< about the sagittal axis
  // Displacement of the incisal point.
  double vertical_opening_mm = 25.0;
  double protrusion_mm = 12.0;
  double laterotrusion_mm = 12.0;
  // Displacement of the condyles.
  double condyle_forward_mm = 15.0;
  double condyle_back_mm = 1.5;
  double condyle_down_mm = 12.0;
  double condyle_up_mm = 2.0;
  double condyle_lateral_mm = 3.0;  ///< of both together (Bennett movement)
  // Where the condyles are taken to be, from the incisal point, unless the joints are known; and how far that
  // can be wrong, which widens their limits by this times the rotation.
  double condyle_behind_mm = 88.0, condyle_above_mm = 35.0, condyle_half_distance_mm = 52.0;
  double condyle_uncertainty_mm = 10.0;
  // Beyond the patient's own recording.
  double envelope_mm = 0.5;
  // Support.
  double contact_mm = 0.05;         ///< gap that counts as contact in MI
  double weaker_side_share = 0.15;  ///< of the contact area that remains, on the weaker side
  double support_margin_mm = 0.0;   ///< of the arch's middle inside the support polygon
  // Joints.
  double condyle_fossa_mm = 0.0;  ///< bone on bone; MI's own overlap, where surfaces have one, lowers it
  double joint_space_mm = 1.0;    ///< less presses the disc
};

/// One row a constraint.
struct LimitRow {
  std::string name;       ///< of the constraint
  std::string what;       ///< its value
  bool at_least = false;  ///< the value must not be below the limit; else not above
  double limit = 0.0;
  std::string unit;
  Severity severity = Severity::kBlocks;
  std::string why;  ///< and where the number comes from
};
/// The table that the constraints are made from; docs/realizability.md has it with the sources in full.
std::vector<LimitRow> limit_table(const RealizabilityLimits& limits = {});

}  // namespace gnathion
