// Whether a splint can hold the mandible where T_th puts it: the constraints of docs/realizability.md.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "anatomy/joint_space.h"
#include "anatomy/limits.h"
#include "anatomy/motion_envelope.h"
#include "core/mesh.h"
#include "core/result.h"
#include "core/transform.h"
#include "occlusion/arch.h"
#include "occlusion/teeth.h"

namespace gnathion {

enum class Verdict { kRealizable, kRealizableWithApertures, kNotRealizable };
const char* verdict_name(Verdict verdict);  ///< as in feasibility.json

struct Constraint {
  std::string name;
  double value = 0.0;
  double limit = 0.0;
  std::string unit;
  bool checked = true;  ///< false: nothing to check it with; value and limit are null in the JSON
  bool pass = true;
  bool at_least = false;  ///< the value must not be below the limit; else not above
  Severity severity = Severity::kBlocks;
  Vector3 where_mm = Vector3::Zero();    ///< in Dental, of the mandible in TP
  std::vector<std::uint8_t> teeth = {};  ///< FDI numbers, ascending
  std::string consequence = {};          ///< what follows, in plain words
  /// Of `value` by T_th's left perturbation (rad, mm); zero where it is not known.
  Vector6 gradient = Vector6::Zero();
  /// Standard deviation of `value` by T_th's covariance (and the joints'), where that is known.
  std::optional<double> sigma = {};
  /// How probable it is that the truth lies on the side of the limit that `pass` says; nothing without sigma.
  std::optional<double> confidence() const;
};

/// The mandible's teeth, each with its room.
struct ToothRoom {
  std::uint8_t fdi = 0, opposing_fdi = 0;
  double clearance_mm = 0.0;  ///< smallest distance to the maxilla; negative inside, and above it
  double vertical_mm = 0.0;   ///< median height of the maxilla over it along the occlusal normal
  bool opposed = false;       ///< the maxilla is over (or under) enough of it to tell vertical_mm
  double overlap_beyond_mi_mm = 0.0, overlap_mm3 = 0.0;
  std::string room;  ///< "wall", "thin wall", "aperture", "none: intersects", "none: above the maxilla"
};

/// How the jaws pass through each other, in TP and in MI.
struct OverlapReport {
  double depth_mm = 0.0, volume_mm3 = 0.0;
  double mi_depth_mm = 0.0, mi_volume_mm3 = 0.0;
  double beyond_mi_mm3() const { return volume_mm3 > mi_volume_mm3 ? volume_mm3 - mi_volume_mm3 : 0.0; }
};

/// The gap between stamp (T_th·S_occ) and mandible in TP, over one part of the lower occlusal surface.
struct StampGap {
  double area_mm2 = 0.0;  ///< of the part that the stamp is over
  double p05_mm = 0.0, median_mm = 0.0, p95_mm = 0.0;
  double contact_mm2 = 0.0;       ///< gap at most contact_mm
  double kept_contact_mm2 = 0.0;  ///< of it, with room for a wall over it
};
/// What carries the mandible in TP.
struct SupportReport {
  StampGap left, front, right, all;  ///< premolars and molars of a side; incisors and canines
  std::vector<Vector3> polygon_mm;   ///< convex hull of the kept contacts seen along the occlusal normal, TP
  double polygon_mm2 = 0.0;
  double margin_mm = 0.0;  ///< of the arch's middle inside the polygon; negative outside
};

/// One joint in TP.
struct JointReport {
  Side side = Side::kLeft;
  JointSpace mi, tp;
  Vector3 condyle_path_mm = Vector3::Zero();  ///< displacement of the condyle's centre: left, back, up
  std::optional<double> sigma_mm;             ///< of tp.min_mm
};

struct Feasibility {
  Verdict verdict = Verdict::kRealizable;
  std::vector<Constraint> constraints;
  ArchFrame arch;
  std::vector<ToothRoom> teeth;  ///< by FDI number
  OverlapReport overlap;
  SupportReport support;
  std::vector<JointReport> joints;  ///< those that are known
  std::string joints_source;        ///< "joints not checked: no CBCT" where there are none
  std::vector<std::string> notes;
  /// Names of the failed constraints that bear on the verdict.
  std::vector<std::string> violated() const;
};

/// Where condyles are on average, from the incisal point (docs/realizability.md has the source). Dental.
Vector3 mean_condyle_mm(const ArchFrame& arch, Side side, const RealizabilityLimits& limits = {});

/// Two jaws made ready (orientation, teeth, distance queries, MI's own overlap and contacts), to be asked
/// about any number of transformations.
class RealizabilityChecker {
 public:
  /// Fails (kInput) only where nothing can be judged: see find_arch.
  static Result<RealizabilityChecker> create(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                                             const RealizabilityLimits& limits = {});
  /// With orientation and teeth that are known, corrections by hand among them.
  static RealizabilityChecker create(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                                     const NamedJaws& named, const RealizabilityLimits& limits = {});
  ~RealizabilityChecker();
  RealizabilityChecker(RealizabilityChecker&&) noexcept;
  RealizabilityChecker& operator=(RealizabilityChecker&&) noexcept;

  /// From now on the joints are checked. Before any check(); not while one runs.
  void use_joints(const Joints& joints);
  /// The patient's own recorded motions of the mandible from MI.
  void use_recording(const std::vector<Rigid3>& motions);

  /// Thread-safe; the result does not depend on the number of threads. `with_support` false leaves
  /// Feasibility::support and what is told from it out.
  Feasibility check(const Motion<Dental>& therapeutic, const std::optional<Matrix6>& covariance = {},
                    bool with_support = true) const;
  const ArchFrame& arch() const;
  const RealizabilityLimits& limits() const;
  /// Centres of the condyles: from the joints, else estimated.
  Vector3 condyle_mm(Side side) const;
  const JointPair& joints() const;

 private:
  struct Jaws;
  explicit RealizabilityChecker(std::unique_ptr<Jaws> jaws);
  std::unique_ptr<Jaws> jaws_;
};

/// Checks one T_th against both jaws in MI.
Result<Feasibility> check_realizability(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                                        const Motion<Dental>& therapeutic,
                                        const RealizabilityLimits& limits = {});

/// feasibility.json: verdict, violated, constraints, and what stands behind them; see docs/realizability.md.
nlohmann::json feasibility_json(const Feasibility& feasibility);

}  // namespace gnathion
