// The virtual patient: everything that is true about it, in the Dental frame at MI.
#pragma once

#include <cstdint>

#include "core/camera_model.h"
#include "core/transform.h"
#include "phantom/bodies.h"
#include "phantom/jaws.h"

namespace gnathion {

struct PhantomPatient {
  PhantomJaws jaws;
  TriangleMesh face;  ///< skin of the upper face, open
  PhantomBody bow, head_frame;
  Transform<Bow, Dental> bow_from_dental;  ///< true T_D: clutch on the lower teeth, jaws in MI
  Transform<HeadFrame, Dental> head_from_dental;
  Motion<Dental> therapeutic;  ///< true T_th
};

PhantomPatient make_phantom_patient(std::uint64_t seed);

/// The rig that films the patient: one camera with mild distortion; bow and head frame as bodies.
Rig phantom_rig(const PhantomPatient& patient);

/// Pose of the head at rest before the camera (the rig's frame).
Transform<Camera, Dental> phantom_camera_from_dental_at_rest();

}  // namespace gnathion
