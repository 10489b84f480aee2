// Whether a splint can hold the mandible where T_th puts it: the five constraints (docs/realizability.md).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/mesh.h"
#include "core/result.h"
#include "core/transform.h"
#include "occlusion/arch.h"

namespace gnathion {

/// Limits with their sources in docs/realizability.md.
struct RealizabilityLimits {
  double wall_mm = 1.0;               ///< clearance where a wall must stand
  double aperture_mm = 0.5;           ///< less room than this: an aperture
  double overlap_beyond_mi_mm = 0.1;  ///< overlap accepted beyond what MI itself shows by computation
  double opening_deg = 35.0;          ///< rotation about the transverse axis
  double closing_deg = 3.0;           ///< the same, the other way
  double yaw_deg = 8.0;               ///< about the occlusal normal
  double roll_deg = 5.0;              ///< about the anterior axis
  double interincisal_mm = 60.0;      ///< displacement of the incisal point along the normal
  double splint_opening_mm = 15.0;    ///< largest height of a splint between the incisal points
  double condyle_protrusion_mm = 12.0;
  double condyle_retrusion_mm = 1.5;
  double condyle_lateral_mm = 3.0;  ///< of both condyles together (Bennett movement)
  double condyle_down_mm = 12.0;    ///< along the eminence
  double condyle_up_mm = 1.5;
  double protrusion_mm = 12.0, laterotrusion_mm = 12.0;  ///< of the incisal point
  // The estimated condyles, from the incisal point along the arch's directions (Bonwill's triangle).
  double condyle_behind_mm = 88.0, condyle_above_mm = 35.0, condyle_half_distance_mm = 52.0;
};

enum class Verdict { kRealizable, kRealizableWithApertures, kNotRealizable };
const char* verdict_name(Verdict verdict);  ///< as in feasibility.json

struct Constraint {
  std::string name;
  double value = 0.0;
  double limit = 0.0;
  std::string unit;
  bool checked = true;  ///< false: value and limit are null in the JSON
  bool pass = true;
  bool blocks = true;  ///< a failure makes the verdict not_realizable
  Vector3 where_mm = Vector3::Zero();
  std::vector<int> teeth;
  std::string consequence;  ///< what follows, in plain words
};

struct Feasibility {
  Verdict verdict = Verdict::kRealizable;
  std::vector<Constraint> constraints;
  ArchFrame arch;
  /// Names of the failed constraints.
  std::vector<std::string> violated() const;
};

/// Checks T_th against both jaws in MI. Fails (kInput) only for what cannot be judged: see find_arch.
Result<Feasibility> check_realizability(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                                        const Motion<Dental>& therapeutic,
                                        const RealizabilityLimits& limits = {});

/// feasibility.json (docs/realizability.md).
nlohmann::json feasibility_json(const Feasibility& feasibility);

}  // namespace gnathion
