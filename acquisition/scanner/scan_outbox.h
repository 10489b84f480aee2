// What a scanner that works in its own threads hands to whoever pulls.
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <string>

#include "acquisition/device.h"

namespace gnathion {

/// Samples of one scanner's stream, its health, its end. All members are thread-safe. Scans are few and are
/// never dropped; the queue has no bound.
class ScanOutbox {
 public:
  explicit ScanOutbox(std::string stream) : stream_(std::move(stream)) {}

  // The scanner's threads.
  /// Header with the next sequence number; capture and arrival as given.
  SampleHeader header(HostTime capture, HostTime arrival);
  void deliver(ScanSample scan);
  void reject(HostTime now, const std::string& why);
  /// An EventSample on "<stream>/state".
  void tell(HostTime now, const std::string& kind, bool pressed, const std::string& text);
  void set_state(DeviceState state, const std::string& message);
  void end();              ///< nothing more comes
  void fail(Error error);  ///< for good

  // The consumer.
  Result<std::optional<Sample>> next();
  DeviceHealth health() const;
  void stop();
  bool stopping() const;

 private:
  void put(Sample sample);
  const std::string stream_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Sample> queue_;
  std::uint32_t sequence_ = 0, events_ = 0;
  DeviceHealth health_;
  std::optional<Error> error_;
  bool stopping_ = false, over_ = false;
};

}  // namespace gnathion
