// The single constraints of realizability, one function each.
#pragma once

#include <string>
#include <vector>

#include "anatomy/realizability.h"
#include "core/mesh_query.h"
#include "occlusion/contacts.h"

namespace gnathion {

/// A piece of the mandible's occlusal surface that the maxilla is over in MI: there the stamp is over it in
/// TP.
struct StampSample {
  Vector3 p_mm;  ///< in MI
  double area_mm2 = 0.0;
  double gap_mm = 0.0;  ///< to the maxilla in MI, which is that to the stamp in TP
  std::uint8_t fdi = 0;
};

/// Per tooth of the mandible.
struct ToothOverlap {
  std::uint8_t fdi = 0;
  double depth_mm = 0.0, volume_mm3 = 0.0;
  Vector3 where_mm = Vector3::Zero();  ///< displaced
};

/// Everything the constraints look at, computed once per transformation.
struct JawsInTp {
  const MeshQuery& maxilla;
  const MeshQuery& mandible;  ///< in MI
  const std::vector<std::uint8_t>& maxilla_fdi;
  const std::vector<std::uint8_t>& mandible_fdi;
  const ArchFrame& arch;
  const RealizabilityLimits& limits;
  const std::vector<LimitRow>& table;
  const Overlap& overlap_mi;
  const std::vector<ToothOverlap>& tooth_overlap_mi;
  const std::vector<StampSample>& stamp;
  const JointPair& joints;
  const MotionEnvelope* envelope;  ///< null: no recording
  Vector3 condyle_left_mm, condyle_right_mm;
  Rigid3 therapeutic;
  Overlap overlap_tp;
  std::vector<ToothOverlap> tooth_overlap_tp;
  std::vector<ToothClearance> clearances;  ///< in TP, per mandibular tooth
};

/// The table's row as a constraint without a value.
Constraint constraint_of(const std::vector<LimitRow>& table, const std::string& name);
/// Gradients by T_th's left perturbation: of a displaced point along a unit direction, and of the rotation
/// about an axis in degrees.
Vector6 gradient_at(const Vector3& moved_mm, const Vector3& direction);
Vector6 turn_gradient_deg(const Vector3& axis);
std::string listed(const std::vector<std::uint8_t>& teeth);
/// Ascending, each once, without 0.
std::vector<std::uint8_t> sorted_teeth(std::vector<std::uint8_t> teeth);

// Room between the jaws.
std::vector<ToothOverlap> tooth_overlaps(const MeshQuery& maxilla, const MeshQuery& mandible,
                                         const std::vector<std::uint8_t>& mandible_fdi, const ArchFrame& arch,
                                         const Rigid3& motion);
Constraint mandible_below_maxilla(const JawsInTp& jaws);
Constraint no_intersection(const JawsInTp& jaws);
Constraint interocclusal_clearance(const JawsInTp& jaws);
Constraint wall_room(const JawsInTp& jaws);
std::vector<ToothRoom> tooth_rooms(const JawsInTp& jaws);

/// Rotations, displacements of the incisal point and of the condyles.
std::vector<Constraint> reachable_from_mi(const JawsInTp& jaws);
Constraint recorded_envelope(const JawsInTp& jaws);  ///< where there is one

// What carries the mandible.
std::vector<StampSample> stamp_samples(const MeshQuery& maxilla, const TriangleMesh& mandible_mi,
                                       const std::vector<std::uint8_t>& mandible_fdi, const ArchFrame& arch);
struct Support {
  SupportReport report;
  std::vector<std::uint8_t> lost_teeth;    ///< with contacts in MI that have no wall over them in TP
  Vector3 centroid_mm = Vector3::Zero();   ///< of the contacts that are kept, in TP
  double left_mm2 = 0.0, right_mm2 = 0.0;  ///< kept contacts by the side of the midline, front teeth too
};
Support support_in_tp(const JawsInTp& jaws);
Constraint uniform_contact(const JawsInTp& jaws, const Support& support);
Constraint support_polygon(const JawsInTp& jaws, const Support& support);

// Joints.
std::vector<JointReport> joint_reports(const JawsInTp& jaws, const std::optional<Matrix6>& covariance);
/// condyle_fossa, and joint_space where the joints are known.
std::vector<Constraint> joint_constraints(const JawsInTp& jaws, const std::vector<JointReport>& reports);

}  // namespace gnathion
