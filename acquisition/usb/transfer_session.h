// What one kind of instrument makes of its transfers, live or replayed: a pure function of them, so that the
// same transfers give the same samples, bit for bit.
#pragma once

#include <deque>
#include <string>

#include "acquisition/clock_estimator.h"
#include "acquisition/usb/transport.h"
#include "core/sample.h"

namespace gnathion {

/// Transfers of a live instrument, each of them recorded before it is answered.
class TransferIo {
 public:
  virtual ~TransferIo() = default;
  /// False when it could not be sent, at once when the device has gone or only fails.
  virtual bool write(std::string_view bytes) = 0;
  /// Takes what arrives for at most `timeout`; false when nothing did, at once when nothing will.
  virtual bool read(std::chrono::milliseconds timeout) = 0;
  /// Give up: the device is to stop, has gone, or only fails.
  virtual bool stopping() const = 0;
};

/// Base of the sessions: the raw stream, its ledger, loss and return. One thread at a time.
class TransferSession {
 public:
  explicit TransferSession(std::string stream) : stream_(std::move(stream)) {}
  virtual ~TransferSession() = default;

  /// The raw transfer, then what was decoded from it.
  void take(const TransferSample& transfer, std::deque<Sample>& out);
  /// Time passes without a transfer: what waits for it comes now.
  void advance(HostTime now, std::deque<Sample>& out) { passed(now, out); }
  /// The end of the session: what is still held back.
  void finish(std::deque<Sample>& out) { ended(out); }

  /// Sets a freshly opened instrument up and starts it; the replies come through take().
  virtual Status start(TransferIo& io);
  /// Tells the instrument to be quiet.
  virtual void stop(TransferIo& io);
  /// A running instrument that is silent for longer is asked to start again; 0: may be silent for ever.
  virtual std::chrono::milliseconds longest_silence() const { return std::chrono::milliseconds(0); }
  virtual ClockEstimate clock() const { return {}; }
  /// What the instrument told of itself, and what is odd about it.
  virtual std::vector<std::string> facts() const { return {}; }
  virtual std::vector<std::string> warnings() const { return {}; }

  const std::string& stream() const { return stream_; }
  std::string raw_stream() const { return stream_ + "/raw"; }

 protected:
  virtual void opened(const TransferSample& descriptors, std::deque<Sample>& out) = 0;
  virtual void sent(const TransferSample& transfer, std::deque<Sample>& out);
  /// Bytes that arrived, also with a transfer that failed.
  virtual void received(const TransferSample& transfer, std::deque<Sample>& out) = 0;
  virtual void lost(const TransferSample& transfer, std::deque<Sample>& out) = 0;
  virtual void passed(HostTime now, std::deque<Sample>& out);
  virtual void ended(std::deque<Sample>& out) = 0;

  /// The instrument is there and does its work: to be called once it is opened and set up.
  void tell_working(HostTime when, std::deque<Sample>& out);
  void tell_state(HostTime when, bool back, const std::string& text, std::deque<Sample>& out);
  static LedgerSample rejected(std::string stream, const SampleHeader& at, std::string reason);

 private:
  std::string stream_;
  std::uint32_t states_ = 0;
  bool present_ = false, was_present_ = false;  ///< and working
};

}  // namespace gnathion
