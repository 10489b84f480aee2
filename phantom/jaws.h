// The virtual patient's jaws: two arches of 14 teeth in maximal intercuspation, with gingiva, palate,
// condyles and fossae.
//
// Dental frame, millimetres: x patient's left, y posterior, z superior; origin at the upper incisal point.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

/// Points where errors and motions are told, Dental frame.
struct PhantomLandmarks {
  Vector3 upper_incisal_point_mm = Vector3::Zero();  ///< midpoint of the edges of 11 and 21: the origin
  Vector3 lower_incisal_point_mm = Vector3::Zero();  ///< midpoint of the edges of 31 and 41, in MI
  Vector3 molar_left_mm = Vector3::Zero();           ///< central fossa of 36, in MI
  Vector3 molar_right_mm = Vector3::Zero();          ///< central fossa of 46, in MI
  Vector3 condyle_left_mm = Vector3::Zero();         ///< centre of the condyle's head, in MI
  Vector3 condyle_right_mm = Vector3::Zero();
};

/// Surfaces are manifold, of one component, and open only at their base (a rim below the gingival band
/// and around the palate), as an intraoral scan is; normals point away from the tissue.
struct PhantomJaws {
  TriangleMesh maxilla, mandible_mi;
  std::vector<std::uint8_t> maxilla_fdi, mandible_fdi;  ///< per vertex: the crown's FDI number, 0 on gingiva
  TriangleMesh condyle_left, condyle_right;             ///< closed, with the mandible in MI
  TriangleMesh fossa_left, fossa_right;                 ///< open surfaces, of the skull
  PhantomLandmarks landmarks;
};

/// The same seed gives the same bytes, on any number of threads. Takes seconds: keep the result.
PhantomJaws make_phantom_jaws(std::uint64_t seed);

}  // namespace gnathion
