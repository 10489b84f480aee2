// What every camera device does alike: frames cross from the camera's thread to the consumer's through a
// bounded queue, and whatever does not cross leaves a ledger line.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <string>

#include "acquisition/device.h"

namespace gnathion {

/// All members are thread-safe. Holds at most `capacity` frames; ledger lines and events do not count, but
/// lines of the same kind and reason that follow one another are one line.
class CameraFeed {
 public:
  enum class WhenFull {
    kReject,  ///< live cameras: the newest frame is rejected, "queue full"
    kWait,    ///< files: the reader waits
  };
  CameraFeed(std::string stream, std::size_t capacity, WhenFull when_full);

  // The camera's thread.
  void deliver(FrameSample frame);
  /// Frames that are not delivered; `count` consecutive sequence numbers from the header's on.
  void account(LedgerSample line);
  /// The instrument went away, or came back.
  void lost(HostTime now, const std::string& why);
  void back(HostTime now, const std::string& text);
  void set_clock(const ClockEstimate& clock);
  /// A line for whoever looks, while running: "waits for triggers".
  void set_message(const std::string& message);
  /// Nothing more comes.
  void end();
  bool stopping() const;
  /// Waits; false as soon as the device is to stop.
  bool pause(std::chrono::milliseconds time);

  // The consumer.
  /// After stop(): what was in hand, then nothing.
  Result<std::optional<Sample>> next();
  DeviceHealth health() const;
  void stop();

 private:
  void put(Sample sample);
  void event(HostTime now, bool is_back, const std::string& text);

  const std::string stream_;
  const std::size_t capacity_;
  const WhenFull when_full_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Sample> queue_;
  std::size_t frames_ = 0;
  std::deque<HostTime> recent_;  ///< arrivals within the last two seconds
  std::uint32_t events_ = 0;
  DeviceHealth health_;
  bool stopping_ = false, over_ = false;
};

}  // namespace gnathion
