// A splint as the link between two instruments: each sees it (or a bow on it) at the same positions, start
// and end at least, and these give the transform between the instruments' frames.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "core/transform.h"

namespace gnathion {

/// One position of the object, seen from both instruments. Covariances are of left perturbations.
struct ObjectPosition {
  std::string name;  ///< "start", "end", …
  Uncertain<Rigid3> a_from_object, b_from_object;
};

struct InstrumentLink {
  Uncertain<Rigid3> a_from_b;
  /// Where the instruments mean different frames by "the object": object_a_from_object_b; else the identity.
  Uncertain<Rigid3> object_a_from_object_b;
  bool common_object_frame = true;
  /// Of the information about both, lengths scaled by 50 mm.
  double condition = 0.0;
  std::vector<std::string> weak;  ///< directions of a_from_b that the positions determine badly, in words
  double rms_mm = 0.0,
         rms_deg = 0.0;  ///< of what does not close: a_from_object against a_from_b · b_from_object
  double chi2 = 0.0, p_value = 1.0;  ///< of the same, against the given covariances
  int degrees_of_freedom = 0;
  /// The motion from the first position to the last, in A as it was seen there and as B's tells it.
  Rigid3 motion_in_a, motion_in_a_by_b;
};

struct LinkOptions {
  /// True: both instruments tell poses of one and the same frame of the object, and one position is enough.
  /// False: each has its own (unknown) frame on it: three positions or more, turned about different axes.
  bool common_object_frame = true;
};

/// Errors (kInput): too few positions, "undetermined" with the directions that stay free, poses that
/// contradict each other grossly (p < 1e-6) are given with p_value and left to the caller.
Result<InstrumentLink> link_instruments(const std::vector<ObjectPosition>& positions,
                                        const LinkOptions& options);

}  // namespace gnathion
