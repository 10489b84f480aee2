// How two jaws meet: measured on their final meshes.
#pragma once

#include <vector>

#include "phantom/jaws.h"

namespace gnathion {

/// A connected patch of the lower teeth within kContactGapMm of the upper jaw.
struct BiteContact {
  int lower_fdi = 0;
  Vector3 point_mm = Vector3::Zero();  ///< where it is closest
  double gap_mm = 0.0;
  double area_mm2 = 0.0;
};
inline constexpr double kContactGapMm = 0.05;

struct PhantomBite {
  std::vector<BiteContact> contacts;  ///< on canines, premolars and molars
  int left = 0, right = 0;
  double overlap_mm = 0.0;  ///< the deepest that a vertex of one jaw lies inside the other
};
PhantomBite measure_bite(const PhantomJaws& jaws);

/// Grinds the lower teeth on their meshes where they reach into the upper ones (facets of wear, a few
/// hundredths of a millimetre deep).
void grind_in(PhantomJaws& jaws);

}  // namespace gnathion
