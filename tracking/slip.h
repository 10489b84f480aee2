// MI that does not close: what slipped, and between which rests.
#pragma once

#include <string>

#include "tracking/plateaus.h"

namespace gnathion {

enum class SlipCause {
  kHeadFrame,  ///< the head frame jumped against the head
  kBow,        ///< the head frame did not: the bow slipped on the teeth, or the bite differs
  kNotTold,    ///< the data does not allow to tell
};

struct Slip {
  std::size_t before = 0, after = 0;  ///< MI rests between which it happened (indices into JawPositions::mi)
  double distance_mm = 0, angle_deg = 0;
  SlipCause cause = SlipCause::kNotTold;
  double at_s = 0;    ///< of the jump, where it was seen
  bool seen = false;  ///< at_s is known
  std::string text() const;
  std::string why;  ///< what tells the cause
};

/// Neighbouring MI rests that are apart beyond 3σ, each with its cause. The head moves smoothly: a slipped
/// head frame jumps in the camera, by just what the closure lacks; a slipped bow leaves it as it is.
std::vector<Slip> find_slips(const SessionMotion& session, const JawPositions& positions,
                             const PlateauOptions& options);

}  // namespace gnathion
