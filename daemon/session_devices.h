// The open devices of an armed session, with what listens to them.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "acquisition/scanner/scan_devices.h"
#include "daemon/config.h"
#include "daemon/heartbeat.h"
#include "daemon/lane.h"
#include "daemon/live_tracker.h"
#include "pipeline/capture_setup.h"

namespace gnathion::daemon {

struct TrackingFiles {
  std::filesystem::path rig, chain;  ///< may be empty
};

/// From Arm to Disarm. Thread-safe once made.
class SessionDevices {
 public:
  /// Opens what can be opened; refused when that is nothing. What is missing stands in missing().
  static Result<std::shared_ptr<SessionDevices>> open(const CaptureSetup& setup, const TrackingFiles& files,
                                                      LiveChannels& channels, Heartbeats& heartbeats,
                                                      Clock& clock);
  ~SessionDevices();

  /// The devices as a recording sees them.
  std::vector<std::unique_ptr<Device>> feeds();
  std::map<std::string, LiveCounts> counts() const;
  std::vector<SessionDevice> health() const;
  bool all_ended() const;
  const std::vector<std::string>& missing() const { return missing_; }
  LiveTracker* tracker() const { return tracker_.get(); }
  std::uint64_t poses() const { return poses_; }
  /// Presses and releases of pedals since the devices were opened.
  std::uint64_t pedal_edges() const { return pedal_edges_; }
  int request_scans();
  void recording_failed();
  void mi_begins(const std::string& what);

 private:
  SessionDevices(LiveChannels& channels, Clock& clock) : channels_(channels), clock_(clock) {}
  Status start_tracker(const TrackingFiles& files, Heartbeats& heartbeats);
  void tell(const Sample& sample, HostTime taken);
  void publish(LivePoses poses);

  LiveChannels& channels_;
  Clock& clock_;
  std::atomic<std::uint64_t> poses_{0}, pedal_edges_{0};
  std::unique_ptr<LiveTracker> tracker_;
  std::vector<ScanOnRequest*> scanners_;
  std::vector<RemembersScans*> remembering_;
  std::vector<std::string> missing_;
  Heartbeats* heartbeats_ = nullptr;
  std::vector<std::unique_ptr<Lane>> lanes_;  ///< last: their threads end first
};

}  // namespace gnathion::daemon
