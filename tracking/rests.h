// Which of the rests found in a session is MI, and which TP, where nobody marked them.
#pragma once

#include <vector>

#include "core/result.h"
#include "tracking/plateaus.h"

namespace gnathion {

/// Rests at one place.
struct RestPlace {
  std::vector<std::size_t> rests;  ///< indices, in order of time
  double rested_s = 0;             ///< in all
  double dispersion_mm = 0;        ///< RMS over its rests
};
/// Places by how often they are visited; of equals by time rested, then by dispersion (least first).
std::vector<RestPlace> rank_places(const std::vector<Plateau>& rests, const PlateauOptions& options);

/// Fills `positions`' mi where it is empty: the place that ranks first. Refused when the jaw never rests; a
/// note says what was assumed, and how the places rank.
Status label_mi(const std::vector<Plateau>& rests, const PlateauOptions& options, JawPositions* positions);
/// Fills tp where it is empty: of all places away from MI the one that the jaw rests at longest in all.
/// Refused when there is none.
Status label_tp(const std::vector<Plateau>& rests, const PlateauOptions& options, JawPositions* positions);

}  // namespace gnathion
