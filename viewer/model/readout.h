// T_th as six numbers that a hand can set, and what it means in the mouth.
#pragma once

#include <array>
#include <optional>

#include "core/mesh.h"
#include "core/rigid.h"
#include "occlusion/arch.h"

namespace gnathion {

/// Displacement of the lower incisal point from MI along the arch's directions, and rotation about axes
/// through that point. The rotation is a rotation vector, so that the six do not depend on an order.
struct SixValues {
  double left_mm = 0, forward_mm = 0, down_mm = 0;
  double opening_deg = 0, yaw_deg = 0, roll_deg = 0;  ///< chin down, chin to the left, left side down
  std::array<double*, 6> all() {
    return {&left_mm, &forward_mm, &down_mm, &opening_deg, &yaw_deg, &roll_deg};
  }
};
SixValues six_of(const Rigid3& therapeutic, const ArchFrame& arch);
Rigid3 motion_of(const SixValues& six, const ArchFrame& arch);

/// Mid-incisal edges of both jaws, in MI.
struct IncisalEdges {
  Vector3 upper_mm = Vector3::Zero(), lower_mm = Vector3::Zero();
};
/// The crowns' ends next to the midline. Nothing where no front tooth stands there.
std::optional<IncisalEdges> incisal_edges(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                                          const ArchFrame& arch);

/// As a clinician reads a jaw position. Overjet: how far the upper edge stands before the lower one;
/// overbite: how far it covers it (negative: open bite). Both between incisal edges.
struct ClinicalReadout {
  double vertical_mm = 0;  ///< change of vertical dimension at the incisal edges
  double overjet_mm = 0, overjet_mi_mm = 0, overbite_mm = 0, overbite_mi_mm = 0;
  double midline_mm = 0;  ///< lower midline's shift to the patient's left
};
ClinicalReadout clinical_readout(const Rigid3& therapeutic, const IncisalEdges& edges, const ArchFrame& arch);

}  // namespace gnathion
