#include "daemon/lane.h"

#include <pthread.h>

#include <atomic>
#include <condition_variable>
#include <deque>
#include <thread>

namespace gnathion::daemon {
namespace {

/// The recording's end of a lane: what the lane's thread puts in comes out of next().
struct FeedQueue {
  FeedQueue(std::size_t queue_bytes, std::size_t reserve_bytes)
      : queue(queue_bytes), intake(queue, reserve_bytes) {}
  SampleQueue queue;
  SampleIntake intake;  ///< the lane's thread alone
};

/// Rates over the last two seconds.
class RateWindow {
 public:
  double add(HostTime now) {
    times_.push_back(now);
    while (now.seconds_since(times_.front()) > 2.0) times_.pop_front();
    const double span_s = now.seconds_since(times_.front());
    return span_s > 0 ? static_cast<double>(times_.size() - 1) / span_s : 0.0;
  }

 private:
  std::deque<HostTime> times_;
};

}  // namespace

struct Lane::State {
  State(std::unique_ptr<Device> d, SampleTap t, Clock& c)
      : device(std::move(d)), tap(std::move(t)), clock(c) {}

  void run();
  void count(const Sample& sample, HostTime taken);
  bool tell(const Sample& sample, HostTime taken);
  void hand_on(Sample sample);
  void end_feed();

  const std::unique_ptr<Device> device;
  const SampleTap tap;
  Clock& clock;
  std::thread thread;
  std::map<std::string, RateWindow> rates;  ///< the lane's thread

  std::mutex tapping;      ///< held while the tap is called
  bool abandoned = false;  ///< the tap may not be called any more

  std::mutex feeding;  ///< held while a sample goes into the feed
  std::shared_ptr<FeedQueue> feed;

  mutable std::mutex mutex;  ///< of what follows
  std::condition_variable changed;
  std::map<std::string, LiveCounts> counts;
  std::string error;
  bool ended = false;
};

void Lane::State::count(const Sample& sample, HostTime taken) {
  const std::string& stream = header_of(sample).stream;
  std::lock_guard lock(mutex);
  LiveCounts& c = counts[stream];
  if (const auto* line = std::get_if<LedgerSample>(&sample)) {
    if (line->fate == LedgerSample::Fate::kRejected) c.rejected += line->count;
    if (line->fate == LedgerSample::Fate::kMissing) c.missing += line->count;
    if (line->fate != LedgerSample::Fate::kAccepted) c.last_reason = line->reason;
    return;
  }
  ++c.received;
  c.rate_hz = rates[stream].add(taken);
}

/// False when nobody listens any more: the lane's owner is gone.
bool Lane::State::tell(const Sample& sample, HostTime taken) {
  std::lock_guard lock(tapping);
  if (abandoned) return false;
  tap(sample, taken);
  return true;
}

void Lane::State::hand_on(Sample sample) {
  std::lock_guard lock(feeding);
  if (feed) feed->intake.put(std::move(sample));
}

void Lane::State::end_feed() {
  std::lock_guard lock(feeding);
  if (!feed) return;
  feed->intake.finish();
  feed->queue.close();
  feed.reset();
}

void Lane::State::run() {
  while (true) {
    Result<std::optional<Sample>> sample = std::optional<Sample>();
    try {
      sample = device->next();
    } catch (const std::exception& e) {
      sample = fail(ErrorCode::kInternal, "device failed", device->description().stream, e.what());
    }
    const HostTime now = clock.now();
    if (!sample) {
      const std::string stream = device->description().stream;
      const EventSample event{{stream + "/state", 0, now, now, {}}, "device", false, sample.error().line()};
      tell(event, now);
      hand_on(event);
      std::lock_guard lock(mutex);
      error = sample.error().line();
      break;
    }
    if (!*sample) break;
    count(**sample, now);
    if (!tell(**sample, now)) break;
    hand_on(std::move(**sample));
  }
  end_feed();
  std::lock_guard lock(mutex);
  ended = true;
  changed.notify_all();
}

namespace {

class LaneFeed : public Device {
 public:
  LaneFeed(std::shared_ptr<FeedQueue> queue, std::function<void()> detach,
           std::function<DeviceDescription()> description, std::function<DeviceHealth()> health)
      : queue_(std::move(queue)),
        detach_(std::move(detach)),
        description_(std::move(description)),
        health_(std::move(health)) {}
  ~LaneFeed() override { stop(); }
  Result<std::optional<Sample>> next() override { return queue_->queue.pop(); }
  DeviceDescription description() const override { return description_(); }
  DeviceHealth health() const override { return health_(); }
  void stop() override { detach_(); }

 private:
  const std::shared_ptr<FeedQueue> queue_;
  const std::function<void()> detach_;
  const std::function<DeviceDescription()> description_;
  const std::function<DeviceHealth()> health_;
};

DeviceHealth health_with(DeviceHealth health, const std::string& error) {
  if (!error.empty()) {
    health.state = DeviceState::kFailed;
    health.message = error;
  }
  return health;
}

}  // namespace

Lane::Lane(std::unique_ptr<Device> device, SampleTap tap, Clock& clock)
    : state_(std::make_shared<State>(std::move(device), std::move(tap), clock)) {
  state_->thread = std::thread([state = state_] { state->run(); });
  ::pthread_setname_np(state_->thread.native_handle(), "lane");
}

Lane::~Lane() {
  state_->device->stop();
  std::unique_lock lock(state_->mutex);
  state_->changed.wait_for(lock, std::chrono::seconds(3), [&] { return state_->ended; });
  const bool ended = state_->ended;
  lock.unlock();
  {
    std::lock_guard tapping(state_->tapping);
    state_->abandoned = true;
  }
  if (ended)
    state_->thread.join();
  else
    state_->thread.detach();
}

std::unique_ptr<Device> Lane::feed(std::size_t queue_bytes, std::size_t reserve_bytes) {
  state_->end_feed();
  auto queue = std::make_shared<FeedQueue>(queue_bytes, reserve_bytes);
  {
    std::scoped_lock lock(state_->feeding, state_->mutex);
    if (state_->ended)
      queue->queue.close();
    else
      state_->feed = queue;
  }
  // A feed that is replaced must not end its successor.
  auto detach = [state = state_, queue] {
    std::lock_guard lock(state->feeding);
    if (state->feed != queue) return;
    state->feed->intake.finish();
    state->feed->queue.close();
    state->feed.reset();
  };
  auto health = [state = state_] {
    std::unique_lock lock(state->mutex);
    const std::string error = state->error;
    lock.unlock();
    return health_with(state->device->health(), error);
  };
  return std::make_unique<LaneFeed>(
      std::move(queue), std::move(detach), [state = state_] { return state->device->description(); },
      std::move(health));
}

DeviceDescription Lane::description() const {
  return state_->device->description();
}

DeviceHealth Lane::health() const {
  std::unique_lock lock(state_->mutex);
  const std::string error = state_->error;
  lock.unlock();
  return health_with(state_->device->health(), error);
}

std::map<std::string, LiveCounts> Lane::counts() const {
  std::lock_guard lock(state_->mutex);
  return state_->counts;
}

bool Lane::ended() const {
  std::lock_guard lock(state_->mutex);
  return state_->ended;
}

Device& Lane::device() {
  return *state_->device;
}

}  // namespace gnathion::daemon
