// Whether a splint can hold the mandible where T_th puts it: the constraints of docs/realizability.md.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"
#include "core/transform.h"
#include "occlusion/arch.h"

namespace gnathion {

/// Limits; each has its source in docs/realizability.md. Displacements are told in the arch's directions,
/// relative to MI.
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
  // Displacement of the estimated condyles.
  double condyle_forward_mm = 15.0;
  double condyle_back_mm = 1.5;
  double condyle_down_mm = 12.0;
  double condyle_up_mm = 2.0;
  double condyle_lateral_mm = 3.0;  ///< of both together (Bennett movement)
  // Where the condyles are taken to be, from the incisal point; and how far that can be wrong, which
  // widens their limits by this times the rotation.
  double condyle_behind_mm = 88.0, condyle_above_mm = 35.0, condyle_half_distance_mm = 52.0;
  double condyle_uncertainty_mm = 10.0;
  // Support.
  double contact_mm = 0.05;         ///< gap that counts as contact in MI
  double weaker_side_share = 0.15;  ///< of the contact area that remains, on the weaker side
};

enum class Verdict { kRealizable, kRealizableWithApertures, kNotRealizable };
const char* verdict_name(Verdict verdict);  ///< as in feasibility.json

/// What a failed constraint does to the verdict.
enum class Severity { kInforms, kApertures, kBlocks };

struct Constraint {
  std::string name;
  double value = 0.0;
  double limit = 0.0;
  std::string unit;
  bool checked = true;  ///< false: nothing to check it with; value and limit are null in the JSON
  bool pass = true;
  Severity severity = Severity::kBlocks;
  Vector3 where_mm = Vector3::Zero();    ///< in Dental, of the mandible in TP
  std::vector<std::uint8_t> teeth = {};  ///< FDI numbers, ascending
  std::string consequence = {};          ///< what follows, in plain words
};

struct Feasibility {
  Verdict verdict = Verdict::kRealizable;
  std::vector<Constraint> constraints;
  ArchFrame arch;
  /// Names of the failed constraints that bear on the verdict.
  std::vector<std::string> violated() const;
};

/// Two jaws made ready (orientation, teeth, distance queries, MI's own overlap and contacts), to be asked
/// about any number of transformations.
class RealizabilityChecker {
 public:
  /// Fails (kInput) only where nothing can be judged: see find_arch.
  static Result<RealizabilityChecker> create(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                                             const RealizabilityLimits& limits = {});
  ~RealizabilityChecker();
  RealizabilityChecker(RealizabilityChecker&&) noexcept;
  RealizabilityChecker& operator=(RealizabilityChecker&&) noexcept;

  /// Thread-safe; the result does not depend on the number of threads.
  Feasibility check(const Motion<Dental>& therapeutic) const;
  const ArchFrame& arch() const;

 private:
  struct Jaws;
  explicit RealizabilityChecker(std::unique_ptr<Jaws> jaws);
  std::unique_ptr<Jaws> jaws_;
};

/// Checks one T_th against both jaws in MI.
Result<Feasibility> check_realizability(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                                        const Motion<Dental>& therapeutic,
                                        const RealizabilityLimits& limits = {});

/// feasibility.json: verdict, violated, constraints; see docs/realizability.md.
nlohmann::json feasibility_json(const Feasibility& feasibility);

}  // namespace gnathion
