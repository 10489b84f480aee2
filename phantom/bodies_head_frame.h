// The head frame: a band around the forehead that carries tags and moves with the maxilla.
#pragma once

#include "phantom/bodies.h"
#include "phantom/face.h"

namespace gnathion {

/// Surface (closed) and tags of the head frame in the Dental frame, worn by this face. Tags 20..29.
PhantomBody make_head_frame_in_dental(const FaceShape& face);

}  // namespace gnathion
