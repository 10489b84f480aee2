// A recorded motion of the jaw, told in the dental frame.
#pragma once

#include <filesystem>

#include "core/result.h"
#include "tracking/motion_file.h"

namespace gnathion {

/// The chain.json that brings a motion to the teeth: the one given, else the one beside the motion; empty:
/// none.
std::filesystem::path calibration_of(const std::filesystem::path& motion,
                                     const std::filesystem::path& calibration);

/// The jaw's motion from MI: motion.csv in the dental frame, or motion.mcap with a chain. Refused with
/// kInput: no valid instant, MI that does not close; with kUsage: motion.mcap without a chain.
Result<JawMotion> read_dental_motion(const std::filesystem::path& motion,
                                     const std::filesystem::path& calibration);

}  // namespace gnathion
