// Poses while the cameras run: one thread follows the bodies from instant to instant. It takes the newest
// instant and leaves out those that came while it was busy; all of them are in the recording.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/camera_model.h"
#include "core/transform.h"
#include "daemon/live_types.h"

namespace gnathion::daemon {

struct LiveTrackerOptions {
  Rig rig;
  std::optional<Transform<Bow, Dental>> bow_from_dental;  ///< T_D of the case's chain
  double same_instant_s = 0.002;
  double partner_wait_s =
      0.006;  ///< how long a frame waits for those of the other cameras; later ones are left out
};

struct LiveTrackerStatus {
  std::uint64_t poses = 0, skipped = 0;
  double rate_hz = 0, latency_ms = 0;  ///< median over the last second, from `taken` to publishing
};

class LiveTracker {
 public:
  using Publish = std::function<void(LivePoses)>;
  /// `publish` is called from the tracker's thread; `clock` outlives it. `round` is called at least every
  /// 100 ms: the loop is alive.
  static Result<std::unique_ptr<LiveTracker>> start(LiveTrackerOptions options, Publish publish,
                                                    std::function<void()> round, Clock& clock);
  ~LiveTracker();
  /// A frame of any stream; those that the rig does not know are passed over. Returns at once.
  void take(std::shared_ptr<const LiveFrame> frame);
  /// "MI" was marked now.
  void mi_begins(const std::string& what);
  LiveTrackerStatus status() const;
  /// Where the tags of the last poses are in one camera's frame.
  LiveTags tags_in(const std::string& stream) const;

 private:
  struct State;
  explicit LiveTracker(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace gnathion::daemon
