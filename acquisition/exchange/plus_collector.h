// From samples to a PLUS sequence: one frame for every instant at which something was captured.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "acquisition/exchange/plus_sequence.h"
#include "core/sample.h"

namespace gnathion {

class PlusCollector {
 public:
  /// Capture time, ns, and a number where one stream has several samples at that time.
  using Instant = std::pair<std::int64_t, std::uint32_t>;
  /// `camera`: the stream whose images go in; empty: poses alone.
  explicit PlusCollector(std::string camera) : camera_(std::move(camera)) {}
  void take(const Sample& sample);
  /// The sequence without its pixels. Times start at the first instant; a frame without a pose or an image
  /// says so in its status. Empty when nothing was taken.
  PlusSequence sequence() const;
  /// The instants, in the order of the frames.
  const std::map<Instant, PlusFrame>& frames() const { return frames_; }
  bool has_images() const { return width_px_ > 0; }

 private:
  void take_pose(const PoseSample& pose);
  PlusFrame& frame_at(const SampleHeader& header, const std::string& transform);
  std::string camera_;
  int width_px_ = 0, height_px_ = 0;
  std::map<Instant, PlusFrame> frames_;
  std::map<std::string, std::string> names_;  ///< of transforms, by stream
  std::set<std::string> taken_;
};

}  // namespace gnathion
