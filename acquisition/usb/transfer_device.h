// Instruments behind USB and HID: opened, kept going, opened again after they were unplugged; and the same
// from a recording of their transfers.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>

#include "acquisition/device.h"
#include "acquisition/usb/transfer_session.h"

namespace gnathion {

/// A live instrument: transfers in, samples out. Reading happens inside next(), so it must be called without
/// long breaks; the USB transport keeps several reads in flight meanwhile.
class TransferDevice : public Device, private TransferIo {
 public:
  /// Fails if the instrument is not there, unless `wait`.
  static Result<std::unique_ptr<TransferDevice>> open(DeviceDescription description,
                                                      std::unique_ptr<TransportFinder> finder,
                                                      std::unique_ptr<TransferSession> session, bool wait,
                                                      Clock& clock);
  ~TransferDevice() override;
  Result<std::optional<Sample>> next() override;
  DeviceDescription description() const override;
  DeviceHealth health() const override;
  void stop() override { stopping_ = true; }

 private:
  TransferDevice(DeviceDescription description, std::unique_ptr<TransportFinder> finder,
                 std::unique_ptr<TransferSession> session, Clock& clock);
  Status connect();
  void reconnect();
  void pump();
  void mind_silence();
  void drop();
  void leave();
  void take(const Transfer& transfer);
  bool write(std::string_view bytes) override;
  bool read(std::chrono::milliseconds timeout) override;
  bool stopping() const override { return stopping_ || gone_ || fails(); }
  bool fails() const;
  void read_rest();
  Sample hand_out();
  void set_state(DeviceState state, const std::string& message);

  Clock& clock_;
  std::unique_ptr<TransportFinder> finder_;
  std::unique_ptr<TransferSession> session_;
  std::unique_ptr<Transport> transport_;
  std::deque<Sample> out_;
  std::uint32_t transfers_ = 0;
  int failures_ = 0, restarts_ = 0, failed_starts_ = 0;  ///< in a row
  bool gone_ = false, was_open_ = false, over_ = false;
  std::uint8_t in_endpoint_ = kDirectionIn;
  HostTime last_data_;
  std::atomic<bool> stopping_ = false;
  const std::vector<std::string> configured_;

  mutable std::mutex mutex_;  ///< of what follows: health() and description() come from other threads
  DeviceDescription description_;
  DeviceHealth health_;
  std::deque<HostTime> recent_;
};

/// Plays the transfers on "<stream>/raw" of a recording through the same session. Everything else in the
/// recording is passed over.
class TransferReplay : public Device {
 public:
  TransferReplay(DeviceDescription description, std::unique_ptr<Source> recording,
                 std::unique_ptr<TransferSession> session);
  Result<std::optional<Sample>> next() override;
  DeviceDescription description() const override { return description_; }
  DeviceHealth health() const override;
  void stop() override { stopping_ = true; }

 private:
  const DeviceDescription description_;
  std::unique_ptr<Source> recording_;
  std::unique_ptr<TransferSession> session_;
  std::deque<Sample> out_;
  bool over_ = false;
  std::atomic<bool> stopping_ = false;
  mutable std::mutex mutex_;
  DeviceHealth health_;
};

}  // namespace gnathion
