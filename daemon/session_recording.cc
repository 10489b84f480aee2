// Recordings of the session, and the marks in them.
#include <algorithm>
#include <utility>

#include "core/log.h"
#include "daemon/recording_place.h"
#include "daemon/session_control_impl.h"
#include "pipeline/version.h"

namespace gnathion::daemon {
namespace {

constexpr const char* kLoop = "session";
constexpr std::int64_t kOldestMark_ns = 60'000'000'000;
constexpr std::size_t kMarkBacklog = 256;

bool is_mark_kind(const std::string& kind) {
  return !kind.empty() && kind.size() <= 32 && std::all_of(kind.begin(), kind.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-';
  });
}

}  // namespace

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
  pedal_edges_before = open_devices->pedal_edges();
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

/// False: the recording takes no more, since its disk or its time has come to an end.
bool SessionControl::Impl::put_mark(const EventSample& event) {
  Sample sample = event;
  if (!marks || !marks->try_push(sample)) return false;
  channels.events.publish(std::make_shared<const EventSample>(event));
  return true;
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
  const auto lost = [](const char* what) {
    return refuse(ApiCode::kUnavailable,
                  fmt::format("{} the recording, which is just ending: look at the session", what));
  };
  if (request.edge != Edge::kRelease) {
    if (!s.put_mark(event)) return lost("the mark is not in");
    event.header.sequence = ++s.mark_count;
    if (request.kind == "MI") s.devices->mi_begins(fmt::format("mark {}", place.sequence));
  }
  if (request.edge != Edge::kPress) {
    event.pressed = false;
    if (!s.put_mark(event))
      return lost(request.edge == Edge::kRelease ? "the mark is not in"
                                                 : "the mark's press is in, but its release is not in");
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
  // Before the other note goes: a crash between loses nothing.
  const bool noted = !finished || note_waiting_recordings(config, not_entered);
  if (noted) forget_running_recording(config);
  last_pedal_edges = open_devices->pedal_edges() - pedal_edges_before;
  session.reset();
  marks.reset();
  enter_waiting(lock);
  if (!noted && not_entered.count(case_id) == 0) forget_running_recording(config);
  state = transition(state, Event::kFileClosed).next;
}

/// What could not be entered since something works in the case, or the disk is full, waits for the next time;
/// with the lock, which is given back meanwhile.
void SessionControl::Impl::enter_waiting(std::unique_lock<std::mutex>& lock) {
  lock.unlock();
  std::lock_guard in_order(entering);  // never an older recording after a newer one
  lock.lock();
  const auto waiting = not_entered;
  lock.unlock();
  std::vector<std::string> done;
  std::map<std::string, Error> faults;
  for (const auto& [id, file] : waiting) {
    const auto entered = enter_recording(root, id, file);
    if (entered && !*entered) continue;
    if (!entered) faults[id] = entered.error();
    if (!entered && !is_final(entered.error())) continue;
    done.push_back(id);
    if (case_changed) case_changed(id);
  }
  lock.lock();
  for (const auto& [id, error] : faults) {  // tried again each second, told once
    const std::string line = error.line() + (is_final(error) ? "" : "; it is tried again");
    if (std::exchange(told_faults[id], line) == line) continue;
    log(LogLevel::kWarning, fmt::format("a recording of {}: {}", id, why_not_entered(error)));
    if (message.empty()) message = line;
  }
  for (const std::string& id : done) {
    if (!faults.count(id) && message == told_faults[id]) message.clear();
    told_faults.erase(id);
    if (not_entered[id] == waiting.at(id)) not_entered.erase(id);
  }
  if (!done.empty()) note_waiting_recordings(config, not_entered);
}

void SessionControl::enter_recordings() {
  std::unique_lock lock(impl_->mutex);
  impl_->enter_waiting(lock);
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

}  // namespace gnathion::daemon
