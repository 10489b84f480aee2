// One temporomandibular joint as two surfaces: how the condyle lies to its fossa when the mandible moves.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "anatomy/joints/joints.h"

namespace gnathion {

/// Where condyle and fossa are closest, or pass deepest into each other. All in Dental.
struct JointSpace {
  double min_mm = 0.0;  ///< smallest distance of the surfaces; negative: depth of the deepest point
  Vector3 condyle_mm = Vector3::Zero();  ///< that place on the condyle, displaced
  Vector3 fossa_mm = Vector3::Zero();    ///< and on the fossa
  Vector3 normal = Vector3::UnitZ();     ///< unit; where the condyle moves along it, min_mm grows
};

/// Immutable, thread-safe. Results do not depend on threads.
class JointQuery {
 public:
  /// Neither surface of the joint is empty. `up` as in ArchFrame.
  JointQuery(const Joint& joint, const Vector3& up);
  ~JointQuery();
  JointQuery(JointQuery&&) noexcept;
  JointQuery& operator=(JointQuery&&) noexcept;

  /// With the mandible displaced from MI by `motion`. Exact between the triangles where the surfaces are
  /// apart. Beyond kReachMm that much is told. A condyle that has gone up through a thin roof, and is free of
  /// bone again above it, counts as inside.
  JointSpace at(const Rigid3& motion) const;
  /// Signed distance of every vertex of the condyle to the fossa; NaN beyond the fossa's rim or `reach_mm`.
  std::vector<double> map_mm(const Rigid3& motion, double reach_mm = 6.0) const;
  const Joint& joint() const;
  const JointSpace& in_mi() const;

  static constexpr double kReachMm = 30.0;

 private:
  struct Surfaces;
  std::unique_ptr<Surfaces> surfaces_;
};

/// What is known of both joints, made ready; a side that is not there was not in the volume.
struct JointPair {
  std::optional<JointQuery> left, right;
  Joints known;
  bool empty() const { return !left && !right; }
};
JointPair ready_joints(const Joints& joints, const Vector3& up);

/// Variance (mm²) of a joint's distance along `space.normal` from everything that was said about errors:
/// T_th's covariance, the joints' poses, the surfaces. Nothing where nothing was said about any of them.
std::optional<double> joint_variance_mm2(const Joints& joints, const JointSpace& space,
                                         const std::optional<Matrix6>& therapeutic_covariance);

}  // namespace gnathion
