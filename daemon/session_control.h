// The session of the daemon: carries out what the table of session_machine.h decides.
//
// Every function may be called from any thread. Commands come one after another; while the devices are being
// opened (seconds for some) others wait. A command that was accepted is done whole, whatever its client does.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "acquisition/session.h"
#include "core/time.h"
#include "daemon/api_error.h"
#include "daemon/config.h"
#include "daemon/heartbeat.h"
#include "daemon/live_tracker.h"
#include "daemon/live_types.h"
#include "daemon/session_machine.h"
#include "pipeline/case_path.h"

namespace gnathion::daemon {

/// What clients see of the session.
struct SessionView {
  State state = State::kIdle;
  std::string case_id, recording, message;
  double elapsed_s = 0;
  std::uint64_t file_bytes = 0, synced_bytes = 0, marks = 0;
  std::vector<std::string> devices_missing;
};

/// What the instruments and the recording are doing.
struct LiveLedger {
  HostTime time;
  std::map<std::string, LiveCounts> streams;
  std::vector<SessionDevice> devices;
  double queue_fill = 0, disk_mib_s = 0, longest_sync_s = 0;
  LiveTrackerStatus tracker;
  std::uint64_t poses = 0;
};

struct MarkRequest {
  std::string kind, text;
  enum class Edge { kBoth, kPress, kRelease } edge = Edge::kBoth;
  HostTime capture;  ///< 0: now
};
struct MarkPlace {
  HostTime capture;
  std::uint32_t sequence = 0;
};

class SessionControl {
 public:
  /// `case_changed` is called, from any thread, when a case.toml has got a recording.
  SessionControl(const DaemonConfig& config, const CaseRoot& root, LiveChannels& channels,
                 Heartbeats& heartbeats, Clock& clock,
                 std::function<void(const std::string& case_id)> case_changed = {});
  ~SessionControl();  ///< as terminate()

  ApiResult<SessionView> arm(const std::string& case_id);
  ApiResult<SessionView> start(const std::string& name);
  ApiResult<MarkPlace> mark(const MarkRequest& request);
  ApiResult<SessionView> stop();
  ApiResult<SessionView> disarm();
  /// Asks every scanner for a scan; how many were asked.
  ApiResult<int> request_scan();
  /// The text of a new devices.toml; the streams that it names.
  ApiResult<std::vector<std::string>> configure(const std::string& devices_toml);

  void holder_gone();
  /// Recordings whose case was at work when they ended: once more, where nothing works in it now.
  void enter_recordings();
  /// A recording ends properly, the devices are closed; afterwards nothing can be armed.
  void terminate();
  /// Settings of the session, at once when it is idle, otherwise as soon as it is.
  void reload(const DaemonConfig& config);

  SessionView view() const;
  LiveLedger ledger() const;
  std::filesystem::path devices_file() const;
  LiveTags tags_in(const std::string& stream) const;
  /// Each change, newest only.
  Hub<SessionView>& changes();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Recordings that a crash cut off become whole files again; one line each. Before the first Arm.
std::vector<std::string> recover_after_crash(const DaemonConfig& config, const CaseRoot& root);

}  // namespace gnathion::daemon
