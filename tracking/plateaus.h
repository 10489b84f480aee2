// MI and TP: rests of the bow relative to the head, averaged on SE(3), with their closure.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/result.h"
#include "core/transform.h"
#include "tracking/session_motion.h"

namespace gnathion {

/// One rest. R = head_from_bow holds all that matters for the jaw; poses in the camera frame follow from it.
struct Plateau {
  double start_s = 0, end_s = 0;  ///< from the session's start
  std::string source;             ///< "pedal", "given", "found"
  int frames = 0;                 ///< valid rows inside
  int frames_used = 0;            ///< of them, not outliers
  Uncertain<Transform<HeadFrame, Bow>> head_from_bow;
  Transform<Camera, HeadFrame> camera_from_head;  ///< mean over the plateau
  double dispersion_mm = 0;  ///< RMS distance of single frames from the mean, at the reference point
  double dispersion_deg = 0;
  double typical_mm = 0;  ///< median of those distances: one glitch or an early mark hardly moves it
  double effective_frames = 0;
  double sigma_mm = 0;  ///< of the mean at the reference point, RMS of the axes' sum
  int rank = 0;         ///< among the rests of its position: 1 has the least sigma

  /// Head at its mean, bow where it is relative to it: the head's motion inside the plateau is removed.
  BowAndHead<Camera> poses() const {
    return {Transform<Camera, Bow>(camera_from_head * head_from_bow.value), camera_from_head};
  }
};

/// Distance between two MI rests: large against its sigma, bow or head frame slipped.
struct Closure {
  std::size_t first = 0, second = 0;     ///< indices into JawPositions::mi
  double distance_mm = 0, sigma_mm = 0;  ///< at the reference point
  double angle_deg = 0, sigma_deg = 0;
  double sigmas = 0;  ///< √(ξᵀ Σ⁻¹ ξ / 6) of the difference
  /// Within what 99.73 % (3σ) of such differences stay: χ² of 6 degrees of freedom up to 20.1.
  bool consistent() const { return sigmas * sigmas <= 20.1 / 6; }
};

struct PlateauOptions {
  using Interval = std::pair<double, double>;  ///< start and end, s from the session's start
  std::vector<Interval> mi_s, tp_s;            ///< given: they go before pedal marks
  Vector3 point_in_bow_mm = Vector3::Zero();   ///< reference point: the incisal point, where known
  double trim_s = 0.05;  ///< cut from both ends of a marked interval: the hand is not the jaw
  int min_frames = 5;
  double rest_speed_mm_s = 3.0;  ///< found plateaus: slower than this at the reference point
  double rest_min_s = 0.3;
  /// Error that the frames of a plateau share and averaging does not lower (bow and lens calibration, the
  /// bite itself): added to each plateau's covariance. As films of virtual patients have it, whose tags lie
  /// the same way between the pixels in all frames of a rest: with 0.003 mm T_B's normalised error was
  /// above 1.25.
  double floor_mm = 0.0055, floor_deg = 0.004;
};

struct JawPositions {
  std::vector<Plateau> mi, tp;
  BowAndHead<Camera> at_mi, at_tp;  ///< of the combined MI and TP
  Uncertain<Transform<HeadFrame, Bow>> head_from_bow_mi, head_from_bow_tp;
  /// T_B: relative_motion(at_mi, at_tp), in the camera frame at MI, with covariance of both rests.
  Uncertain<Motion<Camera>> bow_motion;
  std::vector<Closure> closures;  ///< each MI rest against the first
  bool closes() const;
  std::vector<std::string> notes;  ///< what was assumed, in words
};

/// From given intervals, else pedal marks (events "MI" and "TP", pressed to released), else found. Refused
/// with kInput when there is no MI or no TP, naming what was looked for. A closure that is not consistent is
/// told in `closures` and `notes`, not refused here.
Result<JawPositions> find_jaw_positions(const SessionMotion& session, const PlateauOptions& options);

/// MI alone, in the same way: `tp`, T_B and what follows from them stay empty. For recordings without a TP.
Result<JawPositions> find_mi(const SessionMotion& session, const PlateauOptions& options);

/// The mean over one interval of seconds.
Result<Plateau> plateau_between(const SessionMotion& session, double start_s, double end_s,
                                const PlateauOptions& options);
/// Rests of at least rest_min_s, in order of time.
std::vector<Plateau> find_rests(const SessionMotion& session, const PlateauOptions& options);

}  // namespace gnathion
