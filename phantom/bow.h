// The mandibular bow: a clutch on the labial surfaces of the lower front teeth, a stem through the lips, and
// a carrier with tags before the face.
#pragma once

#include "phantom/bodies.h"
#include "phantom/jaws.h"

namespace gnathion {

/// How the clutch fits.
struct ClutchDesign {
  double tooth_gap_mm = 0.10;  ///< between clutch and lower teeth: the bonding material
  double thickness_mm = 1.8;
  double below_upper_edge_mm = 0.5;  ///< the rim stays this far below the upper incisal edges, in MI
  double maxilla_gap_mm = 0.5;       ///< nothing of the bow comes nearer to the maxilla in MI
};

/// Surface (closed) and tags of the bow in the Dental frame, jaws in MI. Tags 0..11.
PhantomBody make_bow_in_dental(const PhantomJaws& jaws, const ClutchDesign& design = {});

}  // namespace gnathion
