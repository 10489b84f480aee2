// Two cameras' frames of one moment.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <utility>

#include "core/sample.h"

namespace gnathion {

/// Keeps the newest frames of two cameras and finds those taken together. One thread at a time.
class FramePairs {
 public:
  explicit FramePairs(std::int64_t max_skew_ns, std::size_t keep = 16)
      : max_skew_ns_(max_skew_ns), keep_(keep) {}
  void add(int camera, FrameSample frame);
  /// The two frames nearest in capture time, within the skew and not captured before `since`; they and all
  /// that is older are gone then.
  std::optional<std::pair<FrameSample, FrameSample>> take(std::optional<HostTime> since);
  std::size_t size(int camera) const { return frames_[camera].size(); }

 private:
  const std::int64_t max_skew_ns_;
  const std::size_t keep_;
  std::deque<FrameSample> frames_[2];
};

}  // namespace gnathion
