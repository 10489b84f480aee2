// How the virtual patient moves: the mandible through a clinical session, and the head under it.
//
// All motions are told in the phantom's dental frame (x left, y posterior, z up, mm) relative to MI,
// are C2 in time, and depend on their seed alone.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/transform.h"

namespace gnathion {

/// Where the jaw turns and slides.
struct JawGeometry {
  Vector3 condyle_left_mm{50, 92, 36};
  Vector3 condyle_right_mm{-50, 92, 36};
  Vector3 incisal_point_mm{0, 0, 0};
  /// Slope of the condylar path below the xy plane at its start; the eminence flattens along it.
  double condylar_inclination_rad = 0.66;
};

/// Joint coordinates of the mandible; all zero is MI.
struct JawState {
  double opening_rad = 0;     ///< about the intercondylar axis, positive opens
  double slide_left_mm = 0;   ///< of the left condyle along its path (forward and down)
  double slide_right_mm = 0;  ///< of the right condyle
  double side_shift_mm = 0;   ///< Bennett movement of the intercondylar axis, positive to the left
};

/// The rigid motion from MI that the joints impose.
Motion<Dental> motion_of(const JawState& state, const JawGeometry& geometry);

enum class JawPhaseKind {
  kRest,
  kMi,
  kOpening,
  kProtrusion,
  kLaterotrusionLeft,
  kLaterotrusionRight,
  kChewing,
  kTp,
  kTransfer
};

struct JawPhase {
  JawPhaseKind kind;
  std::string name;  ///< "rest", "MI", "opening", …, "TP"; transfers "MI to TP", …
  double start_s = 0, duration_s = 0;
  bool marked = false;  ///< the operator holds the pedal during it
  double end_s() const { return start_s + duration_s; }
};

/// A pedal mark: pressed just after a hold has begun, released just before it ends.
struct JawMark {
  double time_s = 0;
  std::string kind;  ///< "MI" or "TP"
  bool pressed = true;
};

struct JawSequenceOptions {
  std::uint64_t seed = 1;
  double duration_s = 16;        ///< all phases are stretched alike to fill it
  bool border_movements = true;  ///< opening, protrusion, laterotrusions, chewing; without: MI and TP only
  double opening_rad = 0.4363323129985824;  ///< 25°
  int chewing_cycles = 3;
  double tremor_mm = 0.003;  ///< standard deviation at the incisal point, physiological 8–12 Hz
};

/// The mandible's session: rest, MI, border movements, chewing, MI, TP, MI, TP, MI, rest.
class JawSequence {
 public:
  JawSequence(const JawGeometry& geometry, const Motion<Dental>& therapeutic,
              const JawSequenceOptions& options);

  /// From MI to the jaw's position at `time_s` (any real; before and after the sequence: at rest).
  Motion<Dental> mandible_motion(double time_s) const;
  /// The same without tremor: exactly identity in MI holds and exactly T_th in TP holds.
  Motion<Dental> nominal_motion(double time_s) const;

  const std::vector<JawPhase>& phases() const { return phases_; }
  const JawPhase& phase_at(double time_s) const;
  std::vector<JawMark> marks() const;
  double duration_s() const { return phases_.back().end_s(); }

 private:
  struct Tremor {
    double frequency_hz, phase_rad;
    Vector6 amplitude;
  };
  struct Pose {  ///< joints, and how far the way to TP has been gone (0..1)
    JawState joints;
    double tp = 0;
  };
  void add(JawPhaseKind kind, std::string name, double duration_s, bool marked = false);
  void plan(bool border_movements);
  void seed_variation(std::uint64_t seed, double tremor_mm);
  Pose pose_in(const JawPhase& phase, double fraction) const;
  Pose transfer_pose(const JawPhase& phase, double fraction) const;

  JawGeometry geometry_;
  Vector6 therapeutic_log_;
  JawSequenceOptions options_;
  std::vector<JawPhase> phases_;
  std::vector<Tremor> tremor_;
  double protrusion_mm_ = 6, laterotrusion_mm_ = 7, chewing_opening_rad_ = 0.2, chewing_slide_mm_ = 3.5;
  double chewing_side_ = 1;  ///< +1: chews on the left
  double rest_opening_rad_ = 0.028;
};

/// The slow movement of the sitting patient's head: drift, breathing, small nods.
class HeadMotion {
 public:
  /// `amplitude` 1 gives a few millimetres and degrees over the sequence; 0 a head that is fixed.
  HeadMotion(std::uint64_t seed, double duration_s, double amplitude = 1);
  /// Of the maxilla from its place at rest, told in the dental frame at rest.
  Motion<Dental> motion(double time_s) const;

 private:
  struct Wave {
    double frequency_hz, phase_rad;
    Vector6 amplitude;  ///< rotation about the neck (rad), translation (mm)
  };
  struct Nod {
    double centre_s, half_width_s;
    Vector3 rotation_rad;
  };
  std::vector<Wave> waves_;
  std::vector<Nod> nods_;
};

}  // namespace gnathion
