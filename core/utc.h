// Times of day as text, for reports and names; never for decisions.
#pragma once

#include <string>

#include "core/time.h"

namespace gnathion {

/// "2026-01-31T12:00:00Z".
std::string utc_text(HostTime time);

}  // namespace gnathion
