// Frames that are missing by a gap in presentation times, where a source has no counter.
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>

namespace gnathion {

class PtsGap {
 public:
  /// `rate_hz` nominal; 0: not known, no gap is ever seen.
  explicit PtsGap(double rate_hz) : period_s_(rate_hz > 0 ? 1 / rate_hz : 0) {}

  /// How many frames are missing between the last time and this one. Times that do not advance, and gaps of
  /// more than `kLongest` s (a clock that jumped), tell nothing.
  std::uint32_t take(double pts_s) {
    const std::optional<double> last = last_s_;
    last_s_ = pts_s;
    if (!last || period_s_ <= 0) return 0;
    const double step_s = pts_s - *last;
    if (step_s < 1.5 * period_s_ || step_s > kLongest) return 0;
    return static_cast<std::uint32_t>(std::lround(step_s / period_s_)) - 1;
  }

 private:
  static constexpr double kLongest = 60;
  double period_s_;
  std::optional<double> last_s_;
};

}  // namespace gnathion
