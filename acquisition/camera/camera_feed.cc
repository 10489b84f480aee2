#include "acquisition/camera/camera_feed.h"

#include <utility>

namespace gnathion {
namespace {

constexpr std::int64_t kRateWindowNs = 2'000'000'000;
/// Longer than a camera's thread waits for a frame, except where the camera hangs.
constexpr std::chrono::milliseconds kTailWait(500);

/// Whether `line` continues `last`, so that both are one.
bool continues(const LedgerSample& last, const LedgerSample& line) {
  return last.header.stream == line.header.stream && last.fate == line.fate && last.reason == line.reason &&
         last.header.sequence + last.count == line.header.sequence;
}

}  // namespace

CameraFeed::CameraFeed(std::string stream, std::size_t capacity, WhenFull when_full)
    : stream_(std::move(stream)), capacity_(capacity), when_full_(when_full) {
  health_.state = DeviceState::kRunning;
}

void CameraFeed::put(Sample sample) {
  if (auto* line = std::get_if<LedgerSample>(&sample); line && !queue_.empty())
    if (auto* last = std::get_if<LedgerSample>(&queue_.back()); last && continues(*last, *line)) {
      last->count += line->count;
      return;
    }
  queue_.push_back(std::move(sample));
  changed_.notify_all();
}

void CameraFeed::deliver(FrameSample frame) {
  std::unique_lock lock(mutex_);
  if (when_full_ == WhenFull::kWait) changed_.wait(lock, [&] { return stopping_ || frames_ < capacity_; });
  const HostTime arrival = frame.header.arrival;
  recent_.push_back(arrival);
  while (recent_.size() > 2 && recent_.front().ns < arrival.ns - kRateWindowNs) recent_.pop_front();
  if (frames_ < capacity_) {
    ++health_.received;
    ++frames_;
    put(std::move(frame));
    return;
  }
  ++health_.rejected;
  put(LedgerSample{frame.header, LedgerSample::Fate::kRejected, 1, stopping_ ? "stopped" : "queue full"});
}

void CameraFeed::account(LedgerSample line) {
  std::lock_guard lock(mutex_);
  (line.fate == LedgerSample::Fate::kMissing ? health_.missing : health_.rejected) += line.count;
  put(std::move(line));
}

void CameraFeed::event(HostTime now, bool is_back, const std::string& text) {
  EventSample event;
  event.header.stream = stream_ + "/state";
  event.header.sequence = events_++;
  event.header.capture = event.header.arrival = now;
  event.kind = "device";
  event.pressed = is_back;
  event.text = text;
  health_.message = is_back ? "" : text;
  put(std::move(event));
}

void CameraFeed::lost(HostTime now, const std::string& why) {
  std::lock_guard lock(mutex_);
  if (health_.state == DeviceState::kRecovering) return;
  health_.state = DeviceState::kRecovering;
  recent_.clear();
  event(now, false, why);
}

void CameraFeed::back(HostTime now, const std::string& text) {
  std::lock_guard lock(mutex_);
  health_.state = DeviceState::kRunning;
  ++health_.reconnects;
  event(now, true, text);
}

void CameraFeed::set_clock(const ClockEstimate& clock) {
  std::lock_guard lock(mutex_);
  health_.clock = clock;
}

void CameraFeed::set_message(const std::string& message) {
  std::lock_guard lock(mutex_);
  health_.message = message;
}

void CameraFeed::end() {
  std::lock_guard lock(mutex_);
  over_ = true;
  health_.state = DeviceState::kStopped;
  changed_.notify_all();
}

bool CameraFeed::stopping() const {
  std::lock_guard lock(mutex_);
  return stopping_;
}

bool CameraFeed::pause(std::chrono::milliseconds time) {
  std::unique_lock lock(mutex_);
  return !changed_.wait_for(lock, time, [&] { return stopping_; });
}

Result<std::optional<Sample>> CameraFeed::next() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return !queue_.empty() || stopping_ || over_; });
  // What the camera's thread had in hand when it was told to stop still belongs to the recording.
  if (queue_.empty() && !over_) changed_.wait_for(lock, kTailWait, [&] { return !queue_.empty() || over_; });
  if (!queue_.empty()) {
    Sample sample = std::move(queue_.front());
    queue_.pop_front();
    if (std::holds_alternative<FrameSample>(sample)) --frames_;
    changed_.notify_all();
    return sample;
  }
  return std::nullopt;
}

DeviceHealth CameraFeed::health() const {
  std::lock_guard lock(mutex_);
  DeviceHealth health = health_;
  if (recent_.size() > 1 && recent_.back() > recent_.front())
    health.rate_hz = static_cast<double>(recent_.size() - 1) / recent_.back().seconds_since(recent_.front());
  return health;
}

void CameraFeed::stop() {
  std::lock_guard lock(mutex_);
  stopping_ = true;
  health_.state = DeviceState::kStopped;
  changed_.notify_all();
}

}  // namespace gnathion
