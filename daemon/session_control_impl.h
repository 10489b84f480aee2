// The inside of SessionControl, for its own .cc files: session_control.cc (state, devices),
// session_recording.cc (recordings and marks), session_configure.cc (devices.toml).
#pragma once

#include <fmt/format.h>

#include <condition_variable>
#include <map>
#include <mutex>
#include <optional>
#include <thread>

#include "daemon/mark_device.h"
#include "daemon/session_control.h"
#include "daemon/session_devices.h"

namespace gnathion::daemon {

inline tl::unexpected<ApiError> refused(Event event, const Transition& t) {
  return refuse(ApiCode::kFailedPrecondition, fmt::format("cannot {}: {}", name_of(event), t.refusal));
}

struct SessionControl::Impl {
  Impl(const DaemonConfig& c, const CaseRoot& r, LiveChannels& l, Heartbeats& h, Clock& k,
       std::function<void(const std::string&)> changed)
      : config(c), root(r), channels(l), heartbeats(h), clock(k), case_changed(std::move(changed)) {}

  ApiResult<Transition> take(Event event, std::unique_lock<std::mutex>& lock);
  void leave_busy(std::unique_lock<std::mutex>& lock);
  ApiResult<std::shared_ptr<SessionDevices>> open_devices(const std::string& case_id, std::string* warning);
  ApiStatus begin_recording(const std::string& name, std::unique_lock<std::mutex>& lock);
  void end_recording(std::unique_lock<std::mutex>& lock);
  void close_devices(std::unique_lock<std::mutex>& lock);
  bool put_mark(const EventSample& event);
  void enter_waiting(std::unique_lock<std::mutex>& lock);
  void supervise();
  void apply_waiting_config();
  SessionView view_now() const;
  void tell();

  DaemonConfig config;  ///< under mutex
  const CaseRoot& root;
  LiveChannels& channels;
  Heartbeats& heartbeats;
  Clock& clock;
  const std::function<void(const std::string&)> case_changed;
  Hub<SessionView> changes;
  std::thread supervisor;

  std::mutex entering;       ///< held, without the other, while case.toml is edited
  mutable std::mutex mutex;  ///< of what follows
  std::condition_variable settled;
  State state = State::kIdle;
  bool busy = false;  ///< devices or file are being opened or closed: commands wait
  bool terminating = false, stop_supervisor = false;
  std::optional<DaemonConfig> waiting_config;
  std::string case_id, recording, message;
  std::vector<std::string> missing;
  std::shared_ptr<SessionDevices> devices;
  CaptureSetup setup;  ///< as armed
  std::shared_ptr<Session> session;
  std::shared_ptr<MarkDevice::Queue> marks;
  std::uint32_t mark_count = 0;
  /// Of the devices before the recording began, and in the last one that has ended.
  std::uint64_t pedal_edges_before = 0, last_pedal_edges = 0;
  SessionStatus last_status;
  std::map<std::string, std::string> not_entered;  ///< by case: its newest recording, not yet in case.toml
  std::map<std::string, std::string> told_faults;  ///< by case: why that one waits, as it was last told
};

}  // namespace gnathion::daemon
