#include "daemon/session_control.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <map>
#include <mutex>
#include <thread>

#include "core/file.h"
#include "core/log.h"
#include "daemon/client_path.h"
#include "daemon/mark_device.h"
#include "daemon/recording_place.h"
#include "daemon/session_devices.h"
#include "pipeline/case_file.h"
#include "pipeline/version.h"

namespace gnathion::daemon {

namespace fs = std::filesystem;
namespace {

constexpr const char* kLoop = "session";
constexpr std::int64_t kOldestMark_ns = 60'000'000'000;
constexpr std::size_t kMarkBacklog = 256;

bool is_mark_kind(const std::string& kind) {
  return !kind.empty() && kind.size() <= 32 && std::all_of(kind.begin(), kind.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-';
  });
}

/// A client may name devices (/dev), addresses, and files of the case root; no other file of the machine.
ApiStatus paths_stay_inside(const CaptureSetup& setup, const CaseRoot& root) {
  const auto allowed = [&](const DeviceConfig& config, const std::string& text) {
    if (text.find("://") != std::string::npos) return text.rfind("file:", 0) != 0;
    const fs::path path = fs::path(text).is_absolute() ? fs::path(text) : config.folder / text;
    if (may_hold_identity(path)) return false;
    std::error_code ec;
    if (!fs::exists(fs::symlink_status(path, ec))) return !fs::path(text).is_absolute();
    return path.string().rfind("/dev/", 0) == 0 ? path.string().find("..") == std::string::npos
                                                : root.resolve(path.string()).has_value();
  };
  for (const DeviceConfig& config : setup.configs)
    for (const auto& [key, value] : config.settings) {
      std::vector<std::string> texts;
      if (const auto* text = std::get_if<std::string>(&value)) texts = {*text};
      if (const auto* list = std::get_if<std::vector<std::string>>(&value)) texts = *list;
      for (const std::string& text : texts)
        if (!allowed(config, text))
          return refuse(
              ApiCode::kPermissionDenied,
              fmt::format("{}: '{}' names '{}': files must lie in the case root", config.stream, key, text));
    }
  return {};
}

tl::unexpected<ApiError> refused(Event event, const Transition& t) {
  return refuse(ApiCode::kFailedPrecondition, fmt::format("cannot {}: {}", name_of(event), t.refusal));
}

}  // namespace

struct SessionControl::Impl {
  Impl(const DaemonConfig& c, const CaseRoot& r, LiveChannels& l, Heartbeats& h, Clock& k)
      : config(c), root(r), channels(l), heartbeats(h), clock(k) {}

  ApiResult<Transition> take(Event event, std::unique_lock<std::mutex>& lock);
  void leave_busy(std::unique_lock<std::mutex>& lock);
  ApiResult<std::shared_ptr<SessionDevices>> open_devices(const std::string& case_id, std::string* warning);
  ApiStatus begin_recording(const std::string& name, std::unique_lock<std::mutex>& lock);
  void end_recording(std::unique_lock<std::mutex>& lock);
  void close_devices(std::unique_lock<std::mutex>& lock);
  void put_mark(const EventSample& event);
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
  SessionStatus last_status;
  std::map<std::string, std::string> not_entered;  ///< by case: its newest recording, not yet in case.toml
};

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
    s.last_status = {};
  }
  s.leave_busy(lock);
  if (!opened) return tl::unexpected(opened.error());
  return s.view_now();
}

/// With the lock, which is given back while the file is made.
ApiStatus SessionControl::Impl::begin_recording(const std::string& name, std::unique_lock<std::mutex>& lock) {
  SessionOptions options;
  options.queue_bytes = static_cast<std::size_t>(config.queue_mib) << 20;
  options.rigs = setup.rigs;
  options.attachments = setup.attachments;
  options.software_version = kVersion;
  const auto open_devices = devices;
  lock.unlock();
  const auto place = place_for_recording(root, case_id, name);
  if (!place) {
    lock.lock();
    return tl::unexpected(place.error());
  }
  auto queue = std::make_shared<MarkDevice::Queue>(kMarkBacklog);
  const auto crash_note = note_running_recording(config, root, place->file);
  Result<std::unique_ptr<Session>> started =
      fail(ErrorCode::kInternal, "cannot record", place->file.string(), "not begun");
  if (crash_note) {
    auto feeds = open_devices->feeds();
    feeds.push_back(std::make_unique<MarkDevice>(queue));
    started = Session::start(place->file, std::move(feeds), std::move(options), clock);
  }
  lock.lock();
  if (!crash_note) return refuse(crash_note.error());
  if (!started) {
    forget_running_recording(config);
    return refuse(started.error());
  }
  session = std::move(*started);
  marks = std::move(queue);
  mark_count = 0;
  recording = place->inside_case;
  message.clear();
  last_status = session->status();
  return {};
}

ApiResult<SessionView> SessionControl::start(const std::string& name) {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const auto t = s.take(Event::kStart, lock);
  if (!t) return tl::unexpected(t.error());
  s.busy = true;
  const ApiStatus begun = s.begin_recording(name, lock);
  if (begun) s.state = t->next;
  s.leave_busy(lock);
  if (!begun) return tl::unexpected(begun.error());
  return s.view_now();
}

void SessionControl::Impl::put_mark(const EventSample& event) {
  Sample sample = event;
  if (!marks || !marks->try_push(sample)) return;
  channels.events.publish(std::make_shared<const EventSample>(event));
}

ApiResult<MarkPlace> SessionControl::mark(const MarkRequest& request) {
  if (!is_mark_kind(request.kind))
    return refuse(ApiCode::kInvalidArgument,
                  "a mark's kind is 1 to 32 letters, digits, '_' or '-', as in MI, TP, note");
  if (request.text.size() > 1000)
    return refuse(ApiCode::kInvalidArgument, "a mark's text has at most 1000 bytes: shorten it");
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const auto t = s.take(Event::kMark, lock);
  if (!t) return tl::unexpected(t.error());
  const HostTime now = s.clock.now();
  const HostTime at = request.capture.ns == 0 ? now : request.capture;
  if (at > now || now.ns - at.ns > kOldestMark_ns)
    return refuse(ApiCode::kInvalidArgument,
                  "a mark lies at most 60 s back and never ahead: set its time anew");
  if (s.marks->size() + 2 > kMarkBacklog)
    return refuse(ApiCode::kResourceExhausted, "marks come faster than the disk takes them: try again");
  EventSample event{{MarkDevice::kStream, s.mark_count, at, now, {}}, request.kind, true, request.text};
  const MarkPlace place{at, s.mark_count};
  using Edge = MarkRequest::Edge;
  if (request.edge != Edge::kRelease) {
    s.put_mark(event);
    event.header.sequence = ++s.mark_count;
    if (request.kind == "MI") s.devices->mi_begins(fmt::format("mark {}", place.sequence));
  }
  if (request.edge != Edge::kPress) {
    event.pressed = false;
    s.put_mark(event);
    ++s.mark_count;
  }
  s.tell();
  return place;
}

/// With the lock, which is given back while the file is closed; the state is "stopping" meanwhile.
void SessionControl::Impl::end_recording(std::unique_lock<std::mutex>& lock) {
  const auto ending = session;
  const auto open_devices = devices;
  tell();
  lock.unlock();
  const Status finished = ending->finish();
  if (!finished) open_devices->recording_failed();
  lock.lock();
  last_status = ending->status();
  if (!finished) {
    message = "the recording ended early: " + finished.error().line();
    log(LogLevel::kError, message);
  }
  if (finished) not_entered[case_id] = recording;
  forget_running_recording(config);
  session.reset();
  marks.reset();
  enter_waiting(lock);
  state = transition(state, Event::kFileClosed).next;
}

/// What could not be entered since something works in the case waits for the next time; with the lock, which
/// is given back meanwhile.
void SessionControl::Impl::enter_waiting(std::unique_lock<std::mutex>& lock) {
  lock.unlock();
  std::lock_guard in_order(entering);  // never an older recording after a newer one
  lock.lock();
  const auto waiting = not_entered;
  lock.unlock();
  std::vector<std::string> done, faults;
  for (const auto& [id, file] : waiting) {
    const auto entered = enter_recording(root, id, file);
    if (entered && !*entered) continue;
    done.push_back(id);
    if (!entered) faults.push_back(entered.error().line());
  }
  for (const std::string& line : faults) log(LogLevel::kWarning, line);
  lock.lock();
  for (const std::string& id : done)
    if (not_entered[id] == waiting.at(id)) not_entered.erase(id);
  if (!faults.empty() && message.empty()) message = faults.back();
}

ApiResult<SessionView> SessionControl::stop() {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const auto t = s.take(Event::kStop, lock);
  if (!t) return tl::unexpected(t.error());
  s.busy = true;
  s.state = t->next;
  s.end_recording(lock);
  s.leave_busy(lock);
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

ApiResult<std::vector<std::string>> SessionControl::configure(const std::string& devices_toml) {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const auto t = s.take(Event::kConfigure, lock);
  if (!t) return tl::unexpected(t.error());
  const fs::path trial = s.config.devices.string() + ".trial";
  if (const Status written = write_file(trial, devices_toml); !written) return refuse(written.error());
  const auto read = read_capture_setup(trial);
  std::error_code ec;
  const ApiStatus inside = read ? paths_stay_inside(*read, s.root) : ApiStatus();
  if (!read || !inside) fs::remove(trial, ec);
  if (!read) return refuse(read.error(), ApiCode::kInvalidArgument);
  if (!inside) return tl::unexpected(inside.error());
  fs::rename(trial, s.config.devices, ec);
  if (ec)
    return refuse(ApiCode::kInternal,
                  fmt::format("cannot replace {}: {}", s.config.devices.string(), ec.message()));
  std::vector<std::string> streams;
  for (const DeviceConfig& config : read->configs) streams.push_back(config.stream);
  return streams;
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

/// Tells how the recording goes, and ends it when its sources have ended or the disk takes nothing more.
void SessionControl::Impl::supervise() {
  std::unique_lock lock(mutex);
  Stopwatch since_entering;
  while (!stop_supervisor) {
    settled.wait_for(lock, std::chrono::milliseconds(100), [&] { return stop_supervisor; });
    heartbeats.beat(kLoop);
    if (!busy && !not_entered.empty() && since_entering.seconds() > 1) {
      enter_waiting(lock);
      since_entering.restart();
    }
    if (busy || state != State::kRecording) continue;
    last_status = session->status();
    const bool over = last_status.error || devices->all_ended();
    if (over) {
      const Transition t = transition(state, Event::kSourcesEnded);
      busy = true;
      state = t.next;
      message = last_status.error ? "the recording ended early: " + last_status.error->line()
                                  : "the recording ended: no device delivers any more";
      end_recording(lock);
      leave_busy(lock);
    } else {
      tell();
    }
  }
}

SessionControl::SessionControl(const DaemonConfig& config, const CaseRoot& root, LiveChannels& channels,
                               Heartbeats& heartbeats, Clock& clock)
    : impl_(std::make_unique<Impl>(config, root, channels, heartbeats, clock)) {
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
