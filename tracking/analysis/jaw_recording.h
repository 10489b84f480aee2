// What jaw-motion analysis works on: the mandible's motion from MI with its errors, and the points it is read
// at.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "core/transform.h"
#include "tracking/motion_file.h"
#include "tracking/session_motion.h"

namespace gnathion {

/// Valid rows alone, in order of time; a gap shows as a longer step.
struct JawRecording {
  std::vector<double> time_s;
  std::vector<Rigid3> head_from_bow;
  std::vector<Matrix6> covariance;  ///< of each row's left perturbation; errors of rows are independent
  Uncertain<Transform<HeadFrame, Bow>> mi;            ///< R0: shared by all rows
  Uncertain<Transform<Bow, Dental>> bow_from_dental;  ///< T_D: shared by all rows

  /// Motion of the mandible from MI in the dental frame, T_D⁻¹·R0⁻¹·R·T_D.
  std::vector<Rigid3> mandible() const;
};

/// Refused with kInput: fewer than 10 valid rows; poses that are not in millimetres (the bow nearer than
/// 5 mm to the origin in every row, or farther than 10 m).
Result<JawRecording> jaw_recording(const SessionMotion& session,
                                   const Uncertain<Transform<HeadFrame, Bow>>& mi,
                                   const Uncertain<Transform<Bow, Dental>>& bow_from_dental);
/// From motion.csv in the dental frame. Its sigma_mm stands for each row's error at the origin, the same
/// along all axes, with half as much from turning about an axis 80 mm away; errors of MI and T_D are not in
/// such a file.
Result<JawRecording> jaw_recording(const JawMotion& motion);

/// Anatomical directions, unit vectors in the dental frame; left × (−anterior) = up.
struct ReferencePlane {
  std::string name = "occlusal";  ///< "occlusal", "frankfort", "axis-orbital"
  Vector3 left = Vector3::UnitX(), anterior = -Vector3::UnitY(), up = Vector3::UnitZ();

  double leftward(const Vector3& v) const { return left.dot(v); }
  double forward(const Vector3& v) const { return anterior.dot(v); }
  double downward(const Vector3& v) const { return -up.dot(v); }
};

/// The plane through a point on the left, one on the right and one in front. Refused where they are on a
/// line.
Result<ReferencePlane> plane_through(const std::string& name, const Vector3& left_mm, const Vector3& right_mm,
                                     const Vector3& front_mm);

/// Points of the mandible in MI, dental frame, mm.
struct JawLandmarks {
  Vector3 incisal_mm = Vector3::Zero();  ///< lower incisal point, midline
  Vector3 molar_left_mm = Vector3::Zero(),
          molar_right_mm = Vector3::Zero();                  ///< mesiobuccal cusps of the first molars
  std::optional<Vector3> condyle_left_mm, condyle_right_mm;  ///< both or none: then from the hinge axis
  double intercondylar_mm = 110;  ///< where the condyles come from the hinge axis: their distance along it
  double sigma_mm = 0;            ///< of a tooth point, each axis
  double condyle_sigma_mm = 0;    ///< of a given condyle point, each axis
  ReferencePlane plane;
};

/// Refused with kInput, with the distance named: points that no jaw in millimetres has (molars 30–90 mm
/// apart, incisal point 15–75 mm before them, condyles 70–160 mm apart and 50–150 mm from the incisal point,
/// left and right exchanged).
Status check_landmarks(const JawLandmarks& landmarks);

}  // namespace gnathion
