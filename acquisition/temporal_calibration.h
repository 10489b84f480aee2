// The constant offset in time between two streams that see the same motion.
#pragma once

#include <vector>

#include "core/result.h"
#include "core/rigid.h"
#include "core/time.h"

namespace gnathion {

/// A pose at its capture time, in any frame that does not move: reference_from_body.
struct TimedPose {
  HostTime time;
  Rigid3 pose;
};

/// A scalar of the motion that both streams see alike but for gain and bias: rotation rate, a pedal's travel.
struct TimedValue {
  HostTime time;
  double value = 0;
};

struct TemporalCalibrationOptions {
  double max_offset_s = 1.0;    ///< searched on both sides
  double min_overlap_s = 5.0;   ///< of motion that both saw
  double smoothing_s = 0.02;    ///< σ of the kernel that both streams go through alike
  double max_sigma_s = 0.5e-3;  ///< beyond, the motion does not determine the offset
};

struct TemporalCalibration {
  double offset_s = 0;     ///< added to the second stream's times it brings them onto the first's
  double sigma_s = 0;      ///< standard deviation, serial correlation of the residuals included
  double correlation = 0;  ///< of the two signals at the offset
  double runner_up = 0;    ///< correlation of the next best offset that is not the same peak
  double overlap_s = 0;
};

/// Poses of bodies that are rigidly joined, or of one body. Compares rotation rates |ω|, which are the same
/// in every frame and at every point of the body. Times may be unequally spaced and have gaps. Refuses,
/// saying "the motion does not determine the offset" and why: too little common motion, too slow, periodic,
/// not the same motion, offset beyond the search.
Result<TemporalCalibration> calibrate_time_offset(const std::vector<TimedPose>& first,
                                                  const std::vector<TimedPose>& second,
                                                  const TemporalCalibrationOptions& options = {});
/// The same for scalar signals, whose rates of change are compared.
Result<TemporalCalibration> calibrate_time_offset(const std::vector<TimedValue>& first,
                                                  const std::vector<TimedValue>& second,
                                                  const TemporalCalibrationOptions& options = {});

}  // namespace gnathion
