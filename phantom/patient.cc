#include "phantom/patient.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check.h"
#include "core/random.h"
#include "phantom/bodies_head_frame.h"
#include "phantom/bow.h"
#include "phantom/face.h"
#include "phantom/patient_therapy.h"

namespace gnathion {
namespace {

constexpr double kRad = std::numbers::pi / 180.0;

/// CAD frames have origins and axes of their own; nothing in them is parallel to the Dental frame. Each
/// patient's body sits a little differently.
Rigid3 body_from_dental(const Vector3& origin_in_dental_mm, const Vector3& turn_rad, Random& random) {
  const Matrix3 seat = exp_so3(6 * kRad * random.normal3().cwiseMax(-1.5).cwiseMin(1.5));
  const Matrix3 rotation = exp_so3(turn_rad) * seat;
  const Vector3 origin = origin_in_dental_mm + 3.0 * random.normal3().cwiseMax(-2.0).cwiseMin(2.0);
  return {rotation, -(rotation * origin)};
}

}  // namespace

PhantomPatient make_phantom_patient(std::uint64_t seed) {
  PhantomPatient patient;
  patient.jaws = make_phantom_jaws(seed);
  const FaceShape shape = draw_face_shape(seed);
  patient.face = make_face(shape);

  Random random(seed, 0xB0D1E5);
  patient.bow_from_dental.rigid = body_from_dental({4, -58, -9}, {0.62, -1.31, 1.74}, random);
  patient.head_from_dental.rigid = body_from_dental({-6, 20, 98}, {-1.45, 0.83, 0.57}, random);
  patient.bow = transformed(patient.bow_from_dental.rigid, make_bow_in_dental(patient.jaws));
  patient.head_frame = transformed(patient.head_from_dental.rigid, make_head_frame_in_dental(shape));

  patient.therapeutic = draw_therapeutic_position(patient.jaws, seed).motion;
  return patient;
}

Rig phantom_rig(const PhantomPatient& patient) {
  RigCamera camera;
  camera.name = "camera_0";
  camera.model.fx_px = 1100.0;
  camera.model.fy_px = 1100.0;
  camera.model.k1 = -0.08;
  camera.model.k2 = 0.05;
  camera.model.p1 = 0.0005;
  camera.model.p2 = -0.0005;
  camera.line_time_ns = 0;
  Rig rig{{camera}, patient.bow.tags, patient.head_frame.tags};
  rig.bow.up = patient.bow_from_dental.rigid.rotation * Vector3::UnitZ();
  rig.head_frame.up = patient.head_from_dental.rigid.rotation * Vector3::UnitZ();
  return rig;
}

Transform<Camera, Dental> phantom_camera_from_dental_at_rest() {
  // Camera axes: x right = the patient's left, y down, z forward = posterior. The camera stands 400 mm before
  // the bow and is turned a few degrees, as a tripod is.
  Matrix3 facing;
  facing << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  const Matrix3 turned = exp_so3(Vector3(1.5 * kRad, -2.0 * kRad, 1.2 * kRad)) * facing;
  const Vector3 looked_at(1.5, -70, 6);
  return Transform<Camera, Dental>(Rigid3{turned, Vector3(0, 0, 402) - turned * looked_at});
}

}  // namespace gnathion
