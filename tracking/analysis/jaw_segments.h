// A recording cut into movements, by the motion itself or by given intervals.
#pragma once

#include <string>
#include <vector>

#include "tracking/analysis/jaw_recording.h"

namespace gnathion {

enum class JawMovement { kOpening, kProtrusion, kLaterotrusionLeft, kLaterotrusionRight, kChewing, kOther };
const char* name_of(JawMovement movement);
std::optional<JawMovement> movement_of(const std::string& name);  ///< "opening", "laterotrusion left", …

/// From leaving MI to coming back to it (one chewing cycle, or one border movement).
struct JawSegment {
  JawMovement movement = JawMovement::kOther;
  double start_s = 0, end_s = 0;
  double turn_s = 0;             ///< farthest from MI
  std::string source = "found";  ///< or "given"
  bool cut = false;              ///< begins or ends in a gap of the recording, away from MI
};

struct SegmentOptions {
  double at_mi_mm = 0.6;  ///< the incisal point nearer than this to where it is in MI: in MI
  double gap_s = 0.25;    ///< rows farther apart than this end a movement
  int least_chewing_cycles = 3;
  double longest_cycle_s = 1.6;
  std::vector<JawSegment> given;  ///< kinds that are given are not looked for
};

/// Rules, in this order (docs/jaw-motion.md): movements between visits of MI; three and more short opening
/// ones in a row are chewing cycles; else by rotation, advance and sideways movement at the turning point.
std::vector<JawSegment> find_segments(const std::vector<double>& time_s, const std::vector<Rigid3>& mandible,
                                      const JawLandmarks& landmarks, const SegmentOptions& options);

}  // namespace gnathion
