// Which frames of a live rig belong to one instant: every lone one is told. Frames themselves pass untouched;
// what groups them again from a recording are their headers (camera/frame_sync.h).
#pragma once

#include <string>
#include <vector>

#include "acquisition/camera/frame_sync.h"

namespace gnathion {

struct RigOptions {
  std::string name;  ///< "chair": events come on "chair/sync"
  RigSyncOptions sync;
};

struct RigCounts {
  std::string name;
  std::uint64_t sets = 0, lone = 0;
};

/// One thread at a time.
class RigWatch {
 public:
  explicit RigWatch(RigOptions options);
  /// Takes note of a sample that goes by; returns an event of kind "lone" for each frame that is now known to
  /// have no partner: its text names stream, counter and tolerance, its capture is the frame's.
  std::vector<EventSample> look_at(const Sample& sample);
  /// The same for the frames that still wait.
  std::vector<EventSample> finish();
  const RigCounts& counts() const { return counts_; }

 private:
  std::vector<EventSample> told(const std::vector<FrameGrouper::Decision>& decisions);
  std::string stream_;
  FrameGrouper grouper_;
  RigCounts counts_;
  HostTime last_arrival_;
};

}  // namespace gnathion
