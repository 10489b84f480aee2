// The virtual patient as the film's scene.
#pragma once

#include "phantom/film.h"
#include "phantom/patient.h"

namespace gnathion {

/// Rig, bodies and poses of `patient`; the head's surface is head frame, face and upper teeth, the bow's is
/// bow and lower teeth. Surfaces are coarsened for speed (nothing measures them); tags are exact.
FilmScene film_scene(const PhantomPatient& patient);

}  // namespace gnathion
