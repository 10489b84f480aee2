// Small pictures for the eye, few of them.
#pragma once

#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "core/image.h"
#include "daemon/live_types.h"

namespace gnathion::daemon {

/// The mean over blocks of n × n pixels, n the smallest with which it is at most `max_width_px` wide.
Image8 shrunk(const Image8& image, int max_width_px);

/// Which frames a subscriber gets: of its streams, each at most so often.
class PreviewChooser {
 public:
  PreviewChooser(std::set<std::string> streams, double max_rate_hz)
      : streams_(std::move(streams)), interval_ns_(static_cast<std::int64_t>(1e9 / max_rate_hz)) {}
  /// Nothing: not this one. Else how many frames of its stream were left out since the one before.
  std::optional<std::uint64_t> take(const LiveFrame& frame, std::uint64_t lost) {
    const SampleHeader& header = frame.frame.header;
    if (!streams_.empty() && !streams_.count(header.stream)) return std::nullopt;
    Last& last = last_[header.stream];
    last.missed += lost;
    // Half a frame of tolerance, so that 30 Hz out of 60 Hz is every second one in spite of jitter.
    if (last.any && frame.taken.ns - last.taken_ns < interval_ns_ - 4'000'000) {
      ++last.missed;
      return std::nullopt;
    }
    last.taken_ns = frame.taken.ns;
    last.any = true;
    return std::exchange(last.missed, 0);
  }

 private:
  struct Last {
    bool any = false;
    std::int64_t taken_ns = 0;
    std::uint64_t missed = 0;
  };
  const std::set<std::string> streams_;
  const std::int64_t interval_ns_;
  std::map<std::string, Last> last_;
};

}  // namespace gnathion::daemon
