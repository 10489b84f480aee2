// Electromagnetic poses enter as M and H: one sensor on the bow, one on the head, told in the transmitter's
// frame.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/progress.h"
#include "core/source.h"
#include "tracking/session_motion.h"

namespace gnathion {

/// A sensor that is fixed to a body. Of the bow's, bow_from_sensor must be known (calibrate_sensor); of the
/// head's it may be the identity: T_th does not depend on where on the head its sensor sits.
struct SensorMount {
  std::string stream;  ///< "bow/1"
  Uncertain<Rigid3> body_from_sensor;
};

/// Two sensors on one rigid body: what lies between them cannot change, unless metal bends the field.
struct RigidPair {
  std::string first, second;  ///< streams
};

struct ElectromagneticSetup {
  SensorMount bow, head;
  std::vector<RigidPair> pairs;
  double sigma_mm = 0, sigma_deg = 0;  ///< of one reading, each axis; 0: from the recording's own scatter
  double same_instant_s = 0.002;       ///< readings of two sensors this far apart belong together
  /// Distortion: a pair off its median by more than this many standard deviations of the noise and more than
  /// the floor.
  double distortion_sigmas = 5, distortion_mm = 0.5, distortion_deg = 0.5;
  double least_distortion_s = 0.05;  ///< shorter ones are single bad readings
};

/// A time during which a rigid pair was not rigid.
struct Distortion {
  RigidPair pair;
  double start_s = 0, end_s = 0;
  double largest_mm = 0, largest_deg = 0;  ///< off the pair's median distance and rotation
  Vector3 where_mm = Vector3::Zero();      ///< mean position of the first sensor then, transmitter's frame
  std::string text() const;                ///< one line
};

struct ElectromagneticMotion {
  SessionMotion session;  ///< camera_from_… are transmitter_from_…; rows inside a distortion are not valid
  std::vector<Distortion> distortions;
  double sigma_mm = 0, sigma_deg = 0;  ///< of one reading, as used
  std::vector<std::string> notes;
};

/// Pulls the source to its end. Refused with kInput: a stream that the source does not have (those it has are
/// named), poses that are not in millimetres, a pair that is not rigid over most of the recording.
Result<ElectromagneticMotion> electromagnetic_motion(Source& source, const ElectromagneticSetup& setup);

/// One instant at which a camera saw the bow and the tracker its sensor.
struct SensorPair {
  Rigid3 camera_from_bow, transmitter_from_sensor;
  Matrix6 camera_covariance = Matrix6::Zero();
};
struct SensorCalibration {
  Uncertain<Rigid3> bow_from_sensor;
  Rigid3 camera_from_transmitter;  ///< identity where digitised points were used
  double rms_mm = 0, rms_deg = 0;  ///< residuals
  double held_out_mm = 0;          ///< every fifth pair or point left out and predicted
  std::size_t used = 0;
  std::vector<std::string> weak;  ///< directions that the data does not determine, in words
};

/// camera_from_bow_i · X = Y · transmitter_from_sensor_i for X = bow_from_sensor and Y =
/// camera_from_transmitter (AX = XB, both solved together). `sigma_mm`, `sigma_deg` of one electromagnetic
/// reading. Refused with kInput: fewer than 5 pairs, or so little rotation that nothing is determined.
Result<SensorCalibration> calibrate_sensor(const std::vector<SensorPair>& pairs, double sigma_mm,
                                           double sigma_deg);

/// Points of the bow, as in its CAD file, and digitised relative to the sensor by a stylus. At least 4, not
/// on a line.
Result<SensorCalibration> calibrate_sensor_by_points(const std::vector<Vector3>& in_bow_mm,
                                                     const std::vector<Vector3>& in_sensor_mm);

}  // namespace gnathion
