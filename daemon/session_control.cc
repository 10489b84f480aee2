#include "daemon/session_control.h"

#include <algorithm>

#include "core/log.h"
#include "daemon/recording_place.h"
#include "daemon/session_control_impl.h"
#include "pipeline/case_file.h"

namespace gnathion::daemon {

namespace fs = std::filesystem;
namespace {

constexpr const char* kLoop = "session";

}  // namespace

/// Waits until no other command is at work, and asks the table.
ApiResult<Transition> SessionControl::Impl::take(Event event, std::unique_lock<std::mutex>& lock) {
  settled.wait(lock, [&] { return !busy || state == State::kStopping; });
  if (terminating && event != Event::kTerminate && event != Event::kFileClosed)
    return refuse(ApiCode::kUnavailable, "gnathiond is going down: connect again when it is back");
  const Transition t = transition(state, event);
  if (!t.accepted()) return refused(event, t);
  return t;
}

void SessionControl::Impl::leave_busy(std::unique_lock<std::mutex>& lock) {
  if (!lock.owns_lock()) lock.lock();
  busy = false;
  apply_waiting_config();
  settled.notify_all();
  tell();
}

SessionView SessionControl::Impl::view_now() const {
  SessionView v;
  v.state = state;
  v.case_id = case_id;
  v.recording = recording;
  v.message = message;
  v.devices_missing = missing;
  v.marks = mark_count;
  v.marks += session && devices ? devices->pedal_edges() - pedal_edges_before : last_pedal_edges;
  const SessionStatus& s = last_status;
  v.elapsed_s = s.elapsed_s;
  v.file_bytes = s.file_bytes;
  v.synced_bytes = s.synced_bytes;
  return v;
}

void SessionControl::Impl::tell() {
  changes.publish(std::make_shared<const SessionView>(view_now()), true);
}

/// Reads what the case and devices.toml say, then opens; without the lock.
ApiResult<std::shared_ptr<SessionDevices>> SessionControl::Impl::open_devices(const std::string& id,
                                                                              std::string* warning) {
  const auto folder = root.case_folder(id);
  if (!folder)
    return refuse(ApiCode::kNotFound, folder.error().line() + "; `gnathion cases create` makes a case");
  const auto files = read_unfinished_case(*folder, CaseTrust::kConfined);
  if (!files) return refuse(files.error());
  auto read = read_capture_setup(config.devices);
  if (!read) return refuse(read.error());
  setup = std::move(*read);
  TrackingFiles tracking{files->rig.empty() ? config.rig : files->rig, config.chain};
  if (const fs::path own = *folder / "results" / "chain.json"; fs::exists(own)) tracking.chain = own;
  if (tracking.rig.empty()) *warning = "no rig.toml in the case or in gnathiond.toml: cameras give no poses";
  auto opened = SessionDevices::open(setup, tracking, channels, heartbeats, clock);
  if (!opened) return refuse(opened.error());
  return std::move(*opened);
}

ApiResult<SessionView> SessionControl::arm(const std::string& case_id) {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const auto t = s.take(Event::kArm, lock);
  if (!t) return tl::unexpected(t.error());
  s.busy = true;
  s.message.clear();
  lock.unlock();
  std::string warning;
  auto opened = s.open_devices(case_id, &warning);
  lock.lock();
  if (opened) {
    s.state = t->next;
    s.devices = std::move(*opened);
    s.case_id = case_id;
    s.recording.clear();
    s.missing = s.devices->missing();
    s.message = warning;
    s.mark_count = 0;
    s.last_pedal_edges = 0;
    s.last_status = {};
  }
  s.leave_busy(lock);
  if (!opened) return tl::unexpected(opened.error());
  return s.view_now();
}

void SessionControl::Impl::close_devices(std::unique_lock<std::mutex>& lock) {
  auto closing = std::move(devices);
  devices.reset();
  lock.unlock();
  closing.reset();  // joins the devices' threads
  lock.lock();
  state = State::kIdle;
  missing.clear();
}

ApiResult<SessionView> SessionControl::disarm() {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const auto t = s.take(Event::kDisarm, lock);
  if (!t) return tl::unexpected(t.error());
  if (t->action == Action::kCloseDevices) {
    s.busy = true;
    s.close_devices(lock);
    s.leave_busy(lock);
  }
  return s.view_now();
}

ApiResult<int> SessionControl::request_scan() {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const auto t = s.take(Event::kMark, lock);
  if (!t) return tl::unexpected(t.error());
  const int asked = s.devices->request_scans();
  if (asked == 0)
    return refuse(
        ApiCode::kFailedPrecondition,
        "no instrument here scans on request: name a stereo_scanner or depth_camera in devices.toml");
  return asked;
}

void SessionControl::holder_gone() {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const auto t = s.take(Event::kHolderGone, lock);
  if (!t) return;
  if (t->action == Action::kNoteHolderGone) {
    const HostTime now = s.clock.now();
    s.put_mark({{MarkDevice::kStream, s.mark_count++, now, now, {}},
                "client",
                false,
                "the client that held the session has gone"});
    s.message = "the client that held the session has gone; the recording goes on";
    log(LogLevel::kWarning, s.message);
    s.tell();
  } else if (t->action == Action::kCloseDevices) {
    log(LogLevel::kInfo, "the client that held the session has gone: disarmed");
    s.busy = true;
    s.close_devices(lock);
    s.message = "disarmed: the client that held the session has gone";
    s.leave_busy(lock);
  }
}

void SessionControl::terminate() {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  s.terminating = true;
  s.settled.wait(lock, [&] { return !s.busy; });
  const Transition t = transition(s.state, Event::kTerminate);
  s.busy = true;
  s.state = t.next;
  if (t.action == Action::kEndRecordingThenGo) s.end_recording(lock);
  if (s.devices) s.close_devices(lock);
  s.leave_busy(lock);
  if (s.stop_supervisor) return;
  s.stop_supervisor = true;
  s.settled.notify_all();
  lock.unlock();
  if (s.supervisor.joinable()) s.supervisor.join();
  s.changes.close();
}

void SessionControl::reload(const DaemonConfig& config) {
  Impl& s = *impl_;
  std::lock_guard lock(s.mutex);
  s.waiting_config = config;
  if (!s.busy) s.apply_waiting_config();
}

/// Where recordings and state lie never changes while running (needs_restart).
void SessionControl::Impl::apply_waiting_config() {
  if (!waiting_config) return;
  if (transition(state, Event::kReload).action != Action::kReadConfiguration) return;
  config.devices = waiting_config->devices;
  config.rig = waiting_config->rig;
  config.chain = waiting_config->chain;
  config.queue_mib = waiting_config->queue_mib;
  waiting_config.reset();
}

SessionControl::SessionControl(const DaemonConfig& config, const CaseRoot& root, LiveChannels& channels,
                               Heartbeats& heartbeats, Clock& clock,
                               std::function<void(const std::string&)> case_changed)
    : impl_(std::make_unique<Impl>(config, root, channels, heartbeats, clock, std::move(case_changed))) {
  impl_->not_entered = waiting_recordings(config);
  heartbeats.begin(kLoop, 10.0);  // closing a file after a disk's stall takes seconds
  impl_->tell();
  impl_->supervisor = std::thread([s = impl_.get()] { s->supervise(); });
}

SessionControl::~SessionControl() {
  terminate();
  impl_->heartbeats.end(kLoop);
}

SessionView SessionControl::view() const {
  std::lock_guard lock(impl_->mutex);
  return impl_->view_now();
}

LiveLedger SessionControl::ledger() const {
  std::unique_lock lock(impl_->mutex);
  const auto devices = impl_->devices;
  const auto session = impl_->session;
  lock.unlock();
  LiveLedger ledger;
  ledger.time = impl_->clock.now();
  if (devices) {
    ledger.streams = devices->counts();
    ledger.devices = devices->health();
    ledger.poses = devices->poses();
    if (const LiveTracker* tracker = devices->tracker()) ledger.tracker = tracker->status();
  }
  if (!session) return ledger;
  const SessionStatus status = session->status();
  ledger.queue_fill =
      static_cast<double>(status.queue_bytes) / static_cast<double>(status.queue_capacity_bytes);
  ledger.disk_mib_s = status.disk_mib_s;
  ledger.longest_sync_s = status.longest_sync_s;
  for (const auto& [stream, counts] : status.ledger) {
    std::uint64_t rejected = 0;
    for (const auto& [reason, n] : counts.rejected) rejected += n;
    LiveCounts& live = ledger.streams[stream];
    // What the recording had to refuse, beside what the device itself did.
    if (rejected > live.rejected) live.rejected = rejected;
    live.missing = std::max(live.missing, counts.missing);
    if (stream == MarkDevice::kStream) live.received = counts.received;  // no lane counts them
  }
  return ledger;
}

fs::path SessionControl::devices_file() const {
  std::lock_guard lock(impl_->mutex);
  return impl_->config.devices;
}

LiveTags SessionControl::tags_in(const std::string& stream) const {
  std::unique_lock lock(impl_->mutex);
  const auto devices = impl_->devices;
  lock.unlock();
  return devices && devices->tracker() ? devices->tracker()->tags_in(stream) : LiveTags{};
}

Hub<SessionView>& SessionControl::changes() {
  return impl_->changes;
}

}  // namespace gnathion::daemon
