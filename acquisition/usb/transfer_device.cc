#include "acquisition/usb/transfer_device.h"

#include <algorithm>

namespace gnathion {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kReadPatience{50}, kLookAgain{50}, kLongestBackoff{2000};
constexpr int kMaxFailures = 16, kMaxRestarts = 3;  // in a row, before the instrument is opened anew
constexpr int kLastReads = 256;                     // that are still taken when the device stops or goes
constexpr std::int64_t kRateWindowNs = 2'000'000'000;

void count(const Sample& sample, DeviceHealth& health, std::deque<HostTime>& recent) {
  if (const auto* line = std::get_if<LedgerSample>(&sample)) {
    if (line->fate == LedgerSample::Fate::kRejected) health.rejected += line->count;
    if (line->fate == LedgerSample::Fate::kMissing) health.missing += line->count;
    return;
  }
  if (std::holds_alternative<TransferSample>(sample)) return;
  if (const auto* event = std::get_if<EventSample>(&sample); event && event->kind == "device") return;
  ++health.received;
  const HostTime arrival = header_of(sample).arrival;
  recent.push_back(arrival);
  while (arrival.ns - recent.front().ns > kRateWindowNs) recent.pop_front();
}

}  // namespace

TransferDevice::TransferDevice(DeviceDescription description, std::unique_ptr<TransportFinder> finder,
                               std::unique_ptr<TransferSession> session, Clock& clock)
    : clock_(clock),
      finder_(std::move(finder)),
      session_(std::move(session)),
      configured_(description.settings),
      description_(std::move(description)) {}

Result<std::unique_ptr<TransferDevice>> TransferDevice::open(DeviceDescription description,
                                                             std::unique_ptr<TransportFinder> finder,
                                                             std::unique_ptr<TransferSession> session,
                                                             bool wait, Clock& clock) {
  std::unique_ptr<TransferDevice> device(
      new TransferDevice(std::move(description), std::move(finder), std::move(session), clock));
  const Status connected = device->connect();
  if (!connected && !wait) return tl::unexpected(connected.error());
  return device;
}

TransferDevice::~TransferDevice() {
  if (transport_ && !gone_) session_->stop(*this);
}

Result<std::optional<Sample>> TransferDevice::next() {
  while (out_.empty()) {
    if (over_) return std::nullopt;
    if (stopping_)
      leave();
    else if (transport_)
      pump();
    else
      reconnect();
  }
  return hand_out();
}

Status TransferDevice::connect() {
  auto opened = finder_->open();
  if (!opened) {
    set_state(DeviceState::kRecovering, opened.error().line());
    return tl::unexpected(std::move(opened.error()));
  }
  transport_ = std::move(*opened);
  gone_ = false;
  failures_ = restarts_ = 0;
  take(transport_->descriptors());
  Status started = session_->start(*this);
  if (!started) {
    ++failed_starts_;
    set_state(DeviceState::kRecovering, started.error().line());
    transport_.reset();
    return started;
  }
  failed_starts_ = 0;
  last_data_ = clock_.now();
  const InstrumentIdentity& who = transport_->identity();
  {
    const std::lock_guard lock(mutex_);
    description_.vendor = who.manufacturer;
    description_.model = who.model;
    description_.serial = who.serial;
    description_.settings = configured_;
    for (const std::string& fact : session_->facts()) description_.settings.push_back(fact);
    if (was_open_) ++health_.reconnects;
  }
  was_open_ = true;
  set_state(DeviceState::kRunning, {});
  return {};
}

void TransferDevice::reconnect() {
  session_->advance(clock_.now(), out_);
  if (connect() || stopping_) return;
  // Whether something is plugged in is asked often; what is there and does not work is left alone for longer.
  const milliseconds wait = std::min(kLongestBackoff, kLookAgain * (1 << std::min(failed_starts_, 6)));
  for (milliseconds waited{0}; waited < wait && !stopping_; waited += kLookAgain)
    finder_->wait_for_change(kLookAgain);
}

void TransferDevice::pump() {
  if (!read(kReadPatience)) session_->advance(clock_.now(), out_);
  if (gone_ || fails()) return drop();
  mind_silence();
}

/// A tracker that was switched to polling, or fell silent otherwise, is started again.
void TransferDevice::mind_silence() {
  const milliseconds longest = session_->longest_silence();
  const HostTime now = clock_.now();
  if (longest.count() == 0 || now.ns - last_data_.ns < std::chrono::nanoseconds(longest).count()) return;
  take({in_endpoint_, kTransferTimeout, {}, now});
  last_data_ = now;
  const bool again = ++restarts_ <= kMaxRestarts && session_->start(*this);
  if (!again) drop();
}

bool TransferDevice::fails() const {
  return failures_ >= kMaxFailures;
}

void TransferDevice::read_rest() {
  for (int i = 0; i < kLastReads && read(milliseconds(0)); ++i) {
  }
}

/// An unplugged instrument may show errors only; the session is told all the same that it is away.
void TransferDevice::drop() {
  read_rest();
  set_state(DeviceState::kRecovering,
            gone_ ? "unplugged; waiting for it" : "too many errors; opening it again");
  if (!gone_) take({kDescriptorEndpoint, kTransferGone, {}, clock_.now()});
  transport_.reset();
}

void TransferDevice::leave() {
  if (transport_) {
    read_rest();
    if (!gone_) session_->stop(*this);
    transport_.reset();
  }
  session_->finish(out_);
  over_ = true;
  set_state(DeviceState::kStopped, {});
}

void TransferDevice::take(const Transfer& transfer) {
  TransferSample sample;
  sample.header.stream = session_->raw_stream();
  sample.header.sequence = transfers_++;
  sample.header.capture = sample.header.arrival = transfer.arrival;
  sample.endpoint = transfer.endpoint;
  sample.status = transfer.status;
  sample.data = transfer.data;
  session_->take(sample, out_);
  if (transfer.status == kTransferGone) gone_ = true;
}

bool TransferDevice::write(std::string_view bytes) {
  if (gone_ || fails()) return false;
  const Transfer transfer = transport_->write(bytes);
  take(transfer);
  return transfer.status == kTransferOk;
}

bool TransferDevice::read(milliseconds timeout) {
  if (fails()) return false;
  const std::optional<Transfer> transfer = transport_->read(timeout);
  if (!transfer) return false;
  if (gone_ && transfer->status == kTransferGone) return false;  // each further read says so: told once
  in_endpoint_ = transfer->endpoint;
  take(*transfer);
  failures_ = transfer->status == kTransferOk ? 0 : failures_ + 1;
  if (!transfer->data.empty()) {
    last_data_ = transfer->arrival;
    if (transfer->status == kTransferOk) restarts_ = 0;
  }
  return true;
}

Sample TransferDevice::hand_out() {
  Sample sample = std::move(out_.front());
  out_.pop_front();
  const std::lock_guard lock(mutex_);
  count(sample, health_, recent_);
  health_.clock = session_->clock();
  description_.warnings = session_->warnings();
  return sample;
}

void TransferDevice::set_state(DeviceState state, const std::string& message) {
  const std::lock_guard lock(mutex_);
  health_.state = state;
  health_.message = message;
}

DeviceDescription TransferDevice::description() const {
  const std::lock_guard lock(mutex_);
  return description_;
}

DeviceHealth TransferDevice::health() const {
  const std::lock_guard lock(mutex_);
  DeviceHealth health = health_;
  const std::int64_t now = clock_.now().ns;
  const auto recent =
      std::count_if(recent_.begin(), recent_.end(), [&](HostTime t) { return now - t.ns <= kRateWindowNs; });
  health.rate_hz = static_cast<double>(recent) / (static_cast<double>(kRateWindowNs) * 1e-9);
  return health;
}

TransferReplay::TransferReplay(DeviceDescription description, std::unique_ptr<Source> recording,
                               std::unique_ptr<TransferSession> session)
    : description_(std::move(description)), recording_(std::move(recording)), session_(std::move(session)) {}

Result<std::optional<Sample>> TransferReplay::next() {
  while (out_.empty()) {
    if (over_ || stopping_) return std::nullopt;
    GNATHION_TRY(const std::optional<Sample> sample, recording_->next());
    if (!sample) {
      session_->finish(out_);
      over_ = true;
    } else if (const auto* t = std::get_if<TransferSample>(&*sample);
               t && t->header.stream == session_->raw_stream()) {
      session_->take(*t, out_);
    }
  }
  Sample sample = std::move(out_.front());
  out_.pop_front();
  std::deque<HostTime> unused;
  const std::lock_guard lock(mutex_);
  count(sample, health_, unused);
  health_.state = DeviceState::kRunning;
  health_.clock = session_->clock();
  return sample;
}

DeviceHealth TransferReplay::health() const {
  const std::lock_guard lock(mutex_);
  DeviceHealth health = health_;
  if (stopping_) health.state = DeviceState::kStopped;
  return health;
}

}  // namespace gnathion
