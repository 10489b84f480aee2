// Jaw motion in the numbers that clinicians read, each with its definition, the arc it was taken on and its
// error.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tracking/analysis/hinge_axis.h"
#include "tracking/analysis/jaw_recording.h"
#include "tracking/analysis/jaw_segments.h"

namespace gnathion {

/// One figure, or why there is none.
struct JawNumber {
  std::string name;             ///< "sagittal_condylar_inclination_5mm"
  std::string side;             ///< "left", "right" or empty
  double value = 0, sigma = 0;  ///< one standard deviation, from all stated covariances
  std::string unit;             ///< "deg", "mm", "s", "mm2"
  std::string definition;
  double start_s = 0, end_s = 0;  ///< the arc
  int rows = 0;                   ///< rows inside it
  bool determined = false;
  bool grows_with_noise = false;  ///< an outline, widened by each row's error: corrected by simulation
  std::string reason;             ///< why not
};

struct ChewingCycle {
  double start_s = 0, end_s = 0;
  double period_s = 0;                  ///< from the last turning point to this one; 0 for the first
  double opening_mm = 0, width_mm = 0;  ///< vertical and sideways extent of the incisal point's path
  std::string side;                     ///< where the jaw closes from: "left", "right" or "middle"
};

struct JawAnalysisOptions {
  SegmentOptions segments;
  double hinge_arc_deg = 10;        ///< opening arcs from MI up to this rotation
  double hinge_migration_mm = 1.5;  ///< a hinge's axis stays: beyond this (and 3σ) it was no hinge movement
  std::vector<double> chords_mm = {3, 5};  ///< condylar inclination and Bennett angle at these path lengths
  double half_window_s = 0.05;             ///< local quadratic that positions are read from
  int draws = 60;                          ///< of all errors together, for the standard deviations
  std::uint64_t seed = 1;
};

struct JawAnalysis {
  std::vector<JawSegment> segments;
  std::optional<HingeAxis> hinge;
  std::string hinge_reason;   ///< why there is none
  std::string condyles_from;  ///< "landmarks", "hinge axis" or empty: none
  JawLandmarks landmarks;     ///< with the condyles that were used
  std::vector<JawNumber> numbers;
  std::vector<ChewingCycle> cycles;
  std::string chewing_side,
      opening_pattern;  ///< "straight", "corrected deviation to the left", "deflection to the right"
  std::vector<std::string> notes;

  const JawNumber* find(const std::string& name, const std::string& side = "") const;
};

/// Refused with kInput, with the reason: landmarks that no jaw has, a recording that never leaves MI, an axis
/// that no jaw turns about (a chain of another bow, landmarks of another patient, metres). What a recording
/// does not hold is not refused but "not determined", with the reason.
Result<JawAnalysis> analyse_jaw_motion(const JawRecording& recording, const JawLandmarks& landmarks,
                                       const JawAnalysisOptions& options);

}  // namespace gnathion
