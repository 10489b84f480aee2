#include "acquisition/scanner/frame_pairs.h"

#include <cstdlib>

namespace gnathion {

void FramePairs::add(int camera, FrameSample frame) {
  std::deque<FrameSample>& frames = frames_[camera];
  frames.push_back(std::move(frame));
  if (frames.size() > keep_) frames.pop_front();
}

std::optional<std::pair<FrameSample, FrameSample>> FramePairs::take(std::optional<HostTime> since) {
  std::int64_t best = max_skew_ns_ + 1;
  std::size_t best_first = 0, best_second = 0;
  for (std::size_t i = 0; i < frames_[0].size(); ++i)
    for (std::size_t k = 0; k < frames_[1].size(); ++k) {
      const HostTime a = frames_[0][i].header.capture, b = frames_[1][k].header.capture;
      if (since && (a < *since || b < *since)) continue;
      const std::int64_t skew = std::llabs(a.ns - b.ns);
      if (skew >= best) continue;
      best = skew;
      best_first = i;
      best_second = k;
    }
  if (best > max_skew_ns_) return std::nullopt;
  std::pair<FrameSample, FrameSample> pair(std::move(frames_[0][best_first]),
                                           std::move(frames_[1][best_second]));
  frames_[0].erase(frames_[0].begin(), frames_[0].begin() + static_cast<long>(best_first) + 1);
  frames_[1].erase(frames_[1].begin(), frames_[1].begin() + static_cast<long>(best_second) + 1);
  return pair;
}

}  // namespace gnathion
