// The camera's part of the chain's campaign: a session filmed by a camera, and of a bow, that are calibrated
// first and never known.
#pragma once

#include "core/result.h"
#include "phantom/film.h"
#include "phantom/patient.h"
#include "tracking/plateaus.h"

namespace gnathion {

/// For one seed: a camera of its own, calibrated on 24 views of a chessboard; bow and head frame with tags
/// glued 0.1 to 0.3 mm and some tenths of a degree off, each calibrated on 75 views in the hand (corners with
/// a detector's noise); then a session of 5.5 s (MI, TP, MI, TP, MI for about half a second each), rendered,
/// tracked from its pixels with what the calibrations gave, MI and TP by pedal.
Result<JawPositions> filmed_positions(const PhantomPatient& patient, const FilmScene& nominal,
                                      std::uint64_t seed);

}  // namespace gnathion
