// The therapeutic position of the virtual patient: where a dentist would hold the mandible.
#pragma once

#include <cstdint>

#include "core/transform.h"
#include "phantom/jaws.h"

namespace gnathion {

struct TherapeuticPosition {
  Motion<Dental> motion;  ///< from MI
  double opening_deg = 0, protrusion_mm = 0, lateral_mm = 0;
  double posterior_clearance_mm = 0;  ///< smallest distance of premolars and molars to the maxilla
  double clearance_mm = 0;  ///< smallest distance of any lower vertex to the maxilla, negative inside
};

/// Hinge opening of 2–5° about the condylar axis after a slide of 0.5–2 mm down the condylar slope and a
/// slight lateral shift; the opening grows until the jaws are free of each other and the posterior teeth
/// clear by 1 mm.
TherapeuticPosition draw_therapeutic_position(const PhantomJaws& jaws, std::uint64_t seed);

/// Clearances of the mandible moved by `motion`, both ways (lower vertices to the maxilla and upper vertices
/// to the mandible).
void measure_clearance(const PhantomJaws& jaws, TherapeuticPosition& position);

}  // namespace gnathion
