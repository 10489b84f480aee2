// A jaw position as a clinician reads it: vertical dimension, overjet, overbite, midline.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/mesh.h"
#include "core/rigid.h"
#include "occlusion/arch.h"

namespace gnathion {

/// Points of the teeth where a bite is read, in Dental with the mandible in MI.
struct BitePoints {
  Vector3 upper_incisal_mm = Vector3::Zero();  ///< midway between the edges of 11 and 21
  Vector3 lower_incisal_mm = Vector3::Zero();  ///< midway between the edges of 31 and 41
  /// Centroids of the crowns of 36 and 46 (of the next molar or premolar where they are missing).
  std::optional<Vector3> left_molar_mm, right_molar_mm;
};

/// Labels as of assign_teeth() (or the phantom's): one FDI number per vertex, 0 for none. A central incisor
/// stands for both where the other one is missing; nothing where an arch has neither.
std::optional<BitePoints> bite_points(const TriangleMesh& maxilla,
                                      const std::vector<std::uint8_t>& maxilla_fdi,
                                      const TriangleMesh& mandible_mi,
                                      const std::vector<std::uint8_t>& mandible_fdi, const ArchFrame& arch);

/// Overjet and overbite between the incisal edges: overjet along the occlusal plane, positive where the upper
/// edge stands before the lower one; overbite along its normal, positive where it covers the lower one
/// (negative: open bite).
struct BiteReadout {
  double vertical_mm = 0.0;  ///< change of the vertical dimension at the incisors, positive: opened
  std::optional<double> vertical_left_mm, vertical_right_mm;  ///< the same at the molars
  double overjet_mi_mm = 0.0, overjet_mm = 0.0;
  double overbite_mi_mm = 0.0, overbite_mm = 0.0;
  double midline_mm = 0.0;  ///< shift of the lower incisal point to the patient's left
};

/// Of T_th (`therapeutic`: the mandible's motion from MI to TP).
BiteReadout bite_readout(const BitePoints& points, const ArchFrame& arch, const Rigid3& therapeutic);

/// As it stands in design.json and feasibility.json; null where there is none.
nlohmann::json bite_json(const std::optional<BiteReadout>& readout);

}  // namespace gnathion
