// Corrections by hand of the teeth's numbers, against the jaws that they are for.
#pragma once

#include "core/result.h"
#include "design/splint.h"
#include "occlusion/teeth.h"

namespace gnathion {

/// Refuses (kInput), by arch and tooth, corrections that no partition of the arch agrees with: a place that
/// is far from the arch, teeth out of order, no room for a tooth that is said to be there.
Status check_tooth_corrections(const SplintInputs& inputs, const NamedJaws& jaws);

}  // namespace gnathion
