// Condyles and glenoid fossae.
#pragma once

#include "phantom/jaws.h"

namespace gnathion {

/// Makes both joints about the condyles' centres, which are told in `jaws.landmarks`.
void make_joints(PhantomJaws& jaws, std::uint64_t seed);

}  // namespace gnathion
