// Which of the rests found in a session is MI, and which TP, where nobody marked them.
#pragma once

#include <vector>

#include "core/result.h"
#include "tracking/plateaus.h"

namespace gnathion {

/// Fills what is empty of `positions`' mi and tp. MI is the position that the jaw comes back to most often
/// (the first of equals); TP the longest rest that is anywhere else. Refused when the rests do not give both;
/// a note says what was assumed.
Status label_rests(const std::vector<Plateau>& rests, const PlateauOptions& options, JawPositions* positions);

}  // namespace gnathion
