#include "acquisition/scanner/scan_outbox.h"

namespace gnathion {

SampleHeader ScanOutbox::header(HostTime capture, HostTime arrival) {
  std::lock_guard lock(mutex_);
  SampleHeader h;
  h.stream = stream_;
  h.sequence = sequence_++;
  h.capture = capture;
  h.arrival = arrival;
  return h;
}

void ScanOutbox::put(Sample sample) {
  queue_.push_back(std::move(sample));
  changed_.notify_all();
}

void ScanOutbox::deliver(ScanSample scan) {
  std::lock_guard lock(mutex_);
  ++health_.received;
  put(std::move(scan));
}

void ScanOutbox::reject(HostTime now, const std::string& why) {
  LedgerSample line;
  line.header = header(now, now);
  line.fate = LedgerSample::Fate::kRejected;
  line.reason = why;
  std::lock_guard lock(mutex_);
  ++health_.rejected;
  health_.message = why;
  put(std::move(line));
}

void ScanOutbox::tell(HostTime now, const std::string& kind, bool pressed, const std::string& text) {
  std::lock_guard lock(mutex_);
  EventSample event;
  event.header.stream = stream_ + "/state";
  event.header.sequence = events_++;
  event.header.capture = event.header.arrival = now;
  event.kind = kind;
  event.pressed = pressed;
  event.text = text;
  put(std::move(event));
}

void ScanOutbox::set_state(DeviceState state, const std::string& message) {
  std::lock_guard lock(mutex_);
  if (state == DeviceState::kRunning && health_.state == DeviceState::kRecovering) ++health_.reconnects;
  health_.state = state;
  health_.message = message;
}

void ScanOutbox::end() {
  std::lock_guard lock(mutex_);
  over_ = true;
  changed_.notify_all();
}

void ScanOutbox::fail(Error error) {
  std::lock_guard lock(mutex_);
  health_.state = DeviceState::kFailed;
  health_.message = error.line();
  error_ = std::move(error);
  over_ = true;
  changed_.notify_all();
}

Result<std::optional<Sample>> ScanOutbox::next() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return stopping_ || over_ || !queue_.empty(); });
  if (!queue_.empty()) {  // what was scanned before the stop is still handed over
    std::optional<Sample> sample(std::move(queue_.front()));
    queue_.pop_front();
    return sample;
  }
  if (error_) return tl::unexpected<Error>(*error_);
  health_.state = DeviceState::kStopped;
  return std::optional<Sample>();
}

DeviceHealth ScanOutbox::health() const {
  std::lock_guard lock(mutex_);
  return health_;
}

void ScanOutbox::stop() {
  std::lock_guard lock(mutex_);
  stopping_ = true;
  changed_.notify_all();
}

bool ScanOutbox::stopping() const {
  std::lock_guard lock(mutex_);
  return stopping_;
}

}  // namespace gnathion
