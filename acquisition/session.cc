#include "acquisition/session.h"

#include <fmt/format.h>
#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>

#include "acquisition/session_json.h"
#include "acquisition/session_queue.h"

namespace gnathion {

/// Shared by all threads; a device that never comes back keeps it alive.
struct Session::State {
  struct Lane {
    std::unique_ptr<Device> device;
    std::thread thread;
    std::atomic<bool> ended{false};
    std::string error;  ///< under State::mutex
  };

  State(RecordingWriter recording, SessionOptions given, Clock& host_clock)
      : writer(std::move(recording)),
        options(std::move(given)),
        clock(host_clock),
        queue(options.queue_bytes),
        started(clock.now()) {
    for (const RigOptions& rig : options.rigs) watches.emplace_back(rig);
  }

  void run_device(Lane& lane);
  void run_writer();
  void run_sync();
  void write_queue();
  void write(const Sample& sample);
  void publish(HostTime now);
  void lane_ended();
  void disk_failed(const Error& error);
  void stop_devices();
  void leave_the_stuck_behind();
  SessionStatus status();

  RecordingWriter writer;  ///< writer thread; sync() by the sync thread
  const SessionOptions options;
  Clock& clock;
  SampleQueue queue;
  const HostTime started;
  std::vector<RigWatch> watches;  ///< writer thread
  std::vector<std::unique_ptr<Lane>> lanes;
  std::thread writer_thread, sync_thread;
  std::mutex finishing;

  std::mutex mutex;  ///< of what follows
  std::condition_variable changed;
  std::size_t lanes_running = 0;
  bool no_more_syncs = false;
  std::optional<Error> error;
  std::optional<HostTime> ended_at;
  std::map<std::string, LedgerCounts> ledger;
  std::vector<RigCounts> rigs;
  std::deque<std::pair<HostTime, std::uint64_t>> sizes;  ///< of the file, over the last second
  double longest_sync_s = 0, longest_write_s = 0;
};

namespace {

/// A device whose code throws must not take the session with it.
Result<std::optional<Sample>> next_of(Device& device) {
  try {
    return device.next();
  } catch (const std::exception& e) {
    return fail(ErrorCode::kInternal, "device failed", device.description().stream, e.what());
  }
}

EventSample failure_event(const std::string& stream, const Error& error, HostTime now) {
  return {{stream + "/state", 0, now, now, {}}, "device", false, error.line()};
}

}  // namespace

void Session::State::run_device(Lane& lane) {
  SampleIntake intake(queue, options.reserve_bytes);
  while (true) {
    auto sample = next_of(*lane.device);
    if (!sample) {
      intake.put(failure_event(lane.device->description().stream, sample.error(), clock.now()));
      std::lock_guard lock(mutex);
      lane.error = sample.error().line();
      break;
    }
    if (!*sample) break;
    intake.put(std::move(**sample));
  }
  intake.finish();
  lane.ended = true;
  lane_ended();
}

void Session::State::lane_ended() {
  std::lock_guard lock(mutex);
  if (--lanes_running == 0) queue.close();
  changed.notify_all();
}

void Session::State::stop_devices() {
  for (const auto& lane : lanes) lane->device->stop();
}

/// Joins the threads that have ended. A driver that hangs keeps its own thread, and this state with it.
void Session::State::leave_the_stuck_behind() {
  for (const auto& lane : lanes) {
    if (!lane->thread.joinable()) continue;
    if (lane->ended) {
      lane->thread.join();
      continue;
    }
    lane->thread.detach();
    std::lock_guard lock(mutex);
    lane->error = "did not stop within 3 s; its last samples are missing";
  }
}

void Session::State::disk_failed(const Error& why) {
  {
    std::lock_guard lock(mutex);
    if (error) return;
    error = why;
    changed.notify_all();
  }
  stop_devices();
}

void Session::State::publish(HostTime now) {
  const std::uint64_t bytes = writer.file_bytes();
  std::lock_guard lock(mutex);
  ledger = writer.ledger();
  rigs.clear();
  for (const RigWatch& watch : watches) rigs.push_back(watch.counts());
  sizes.emplace_back(now, bytes);
  while (sizes.size() > 2 && now.seconds_since(sizes[1].first) > 1.0) sizes.pop_front();
}

/// The sample, and the lone frames of rigs that it makes known.
void Session::State::write(const Sample& sample) {
  if (const Status status = writer.write(sample); !status) disk_failed(status.error());
  for (RigWatch& watch : watches)
    for (const EventSample& event : watch.look_at(sample))
      if (const Status status = writer.write(event); !status) disk_failed(status.error());
}

/// Until the queue is closed and empty. After an error of the disk samples are still taken, to be accounted
/// for.
void Session::State::write_queue() {
  constexpr std::chrono::milliseconds kIdle(10);
  constexpr std::int64_t kPublish_ns = 100'000'000;
  HostTime published = clock.now(), chunk_opened = published;
  std::uint64_t bytes = writer.file_bytes();
  bool open = false;  ///< a chunk
  while (true) {
    auto sample = queue.pop_within(kIdle);
    const HostTime now = clock.now();
    if (sample) {
      const Stopwatch watch;
      write(*sample);
      if (watch.seconds() > longest_write_s) {
        std::lock_guard lock(mutex);
        longest_write_s = watch.seconds();
      }
      if (!open || writer.file_bytes() != bytes) chunk_opened = now;
      open = true;
    } else if (queue.drained()) {
      return;
    }
    bytes = writer.file_bytes();
    // A chunk that nothing follows is closed by the clock. The clock may be set back: then at once.
    const std::int64_t age_ns = now.ns - chunk_opened.ns;
    if (open && (age_ns >= options.recording.max_chunk_ns || age_ns < 0)) {
      if (const Status status = writer.flush(); !status) disk_failed(status.error());
      open = false;
      bytes = writer.file_bytes();
    }
    if (now.ns - published.ns >= kPublish_ns || now < published) {
      publish(now);
      published = now;
    }
  }
}

void Session::State::run_writer() {
  write_queue();
  for (RigWatch& watch : watches)
    for (const EventSample& event : watch.finish())
      if (const Status status = writer.write(event); !status) disk_failed(status.error());
  {
    std::lock_guard lock(mutex);
    no_more_syncs = true;
    changed.notify_all();
  }
  sync_thread.join();
  publish(clock.now());
  // After an error there is only room for the index.
  (void)writer.attach("session_end.json", "application/json", session_end_json(status()));
  if (const Status status = writer.finish(); !status) disk_failed(status.error());
  publish(clock.now());
  std::lock_guard lock(mutex);
  ended_at = clock.now();
}

/// From start to start of a sync, so that a slow disk does not stretch the interval.
void Session::State::run_sync() {
  using std::chrono::duration;
  const double interval_s = 1e-3 * options.sync_interval_ms;
  double took_s = 0;
  std::unique_lock lock(mutex);
  while (!changed.wait_for(lock, duration<double>(std::max(0.001, interval_s - took_s)),
                           [&] { return no_more_syncs; })) {
    lock.unlock();
    const Stopwatch watch;
    const Status synced = writer.sync();
    took_s = watch.seconds();
    if (!synced) {
      disk_failed(synced.error());
      return;
    }
    lock.lock();
    longest_sync_s = std::max(longest_sync_s, took_s);
  }
}

SessionStatus Session::State::status() {
  SessionStatus s;
  for (const auto& lane : lanes)
    s.devices.push_back({lane->device->description(), lane->device->health(), lane->ended});
  s.queue_bytes = queue.cost();
  s.queue_peak_bytes = queue.peak_cost();
  s.queue_capacity_bytes = options.queue_bytes;
  s.file_bytes = writer.file_bytes();
  s.synced_bytes = writer.synced_bytes();
  std::lock_guard lock(mutex);
  for (std::size_t i = 0; i < lanes.size(); ++i)
    if (!lanes[i]->error.empty()) {
      s.devices[i].health.state = DeviceState::kFailed;
      s.devices[i].health.message = lanes[i]->error;
    }
  s.running = lanes_running > 0 && !error;
  s.error = error;
  s.elapsed_s = ended_at.value_or(clock.now()).seconds_since(started);
  s.ledger = ledger;
  s.rigs = rigs;
  if (sizes.size() > 1) {
    const double span_s = sizes.back().first.seconds_since(sizes.front().first);
    const auto grown =
        static_cast<double>(sizes.back().second - std::min(sizes.front().second, sizes.back().second));
    s.disk_mib_s = span_s > 0 ? grown / 1048576.0 / span_s : 0.0;
  }
  s.longest_sync_s = longest_sync_s;
  s.longest_write_s = longest_write_s;
  return s;
}

namespace {

/// What does not change during the session stands first, and durably: a crash cannot lose it.
Result<RecordingWriter> begin_recording(const std::filesystem::path& path, const SessionOptions& options,
                                        const std::vector<DeviceDescription>& devices) {
  GNATHION_TRY(RecordingWriter writer, RecordingWriter::create(path, options.recording));
  GNATHION_CHECK_OK(writer.attach("session.json", "application/json", session_start_json(options, devices)));
  for (const auto& [name, bytes] : options.attachments)
    GNATHION_CHECK_OK(writer.attach(name, "application/octet-stream", bytes));
  GNATHION_CHECK_OK(writer.sync());
  return writer;
}

}  // namespace

Session::Session(std::shared_ptr<State> state) : state_(std::move(state)) {}

Result<std::unique_ptr<Session>> Session::start(const std::filesystem::path& path,
                                                std::vector<std::unique_ptr<Device>> devices,
                                                SessionOptions options, Clock& clock) {
  if (devices.empty())
    return bad_input("cannot start a session", path.string(), "there is no device to record from");
  std::vector<DeviceDescription> descriptions;
  for (const auto& device : devices) descriptions.push_back(device->description());
  std::error_code ec;
  const bool was_there = std::filesystem::exists(path, ec);
  auto writer = begin_recording(path, options, descriptions);
  if (!writer) {
    if (!was_there) std::filesystem::remove(path, ec);
    return tl::unexpected<Error>(writer.error());
  }
  auto state = std::make_shared<State>(std::move(*writer), std::move(options), clock);
  for (auto& device : devices) {
    state->lanes.push_back(std::make_unique<State::Lane>());
    state->lanes.back()->device = std::move(device);
  }
  state->lanes_running = state->lanes.size();
  state->sync_thread = std::thread([s = state.get()] { s->run_sync(); });
  state->writer_thread = std::thread([s = state.get()] { s->run_writer(); });
  ::pthread_setname_np(state->sync_thread.native_handle(), "sync");
  ::pthread_setname_np(state->writer_thread.native_handle(), "writer");
  for (auto& lane : state->lanes)
    lane->thread = std::thread([state, l = lane.get()] { state->run_device(*l); });
  return std::unique_ptr<Session>(new Session(std::move(state)));
}

Session::~Session() {
  (void)finish();
}

SessionStatus Session::status() const {
  return state_->status();
}

bool Session::wait_for(double seconds) {
  State& s = *state_;
  std::unique_lock lock(s.mutex);
  return s.changed.wait_for(lock, std::chrono::duration<double>(seconds),
                            [&] { return s.lanes_running == 0 || s.error.has_value(); });
}

Status Session::finish() {
  State& s = *state_;
  std::lock_guard once(s.finishing);
  if (s.writer_thread.joinable()) {
    s.stop_devices();
    std::unique_lock lock(s.mutex);
    s.changed.wait_for(lock, std::chrono::seconds(3), [&] { return s.lanes_running == 0; });
  }
  s.leave_the_stuck_behind();
  s.queue.close();
  if (s.writer_thread.joinable()) s.writer_thread.join();
  std::lock_guard lock(s.mutex);
  return s.error ? Status(tl::unexpected<Error>(*s.error)) : Status();
}

}  // namespace gnathion
