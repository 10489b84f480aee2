#include "acquisition/igtl/igtl_device.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <deque>
#include <mutex>

#include "acquisition/igtl/igtl_socket.h"
#include "acquisition/igtl/igtl_translator.h"

namespace gnathion {
namespace {

using igtl::Framer;
using igtl::SocketEvent;
using igtl::TcpClient;
using igtl::Translator;

constexpr const char* kKind = "openigtlink";
constexpr int kWaitMs = 100;  // the longest wait, so that silence is seen
constexpr int kConnectMs = 2000;
constexpr int kFirstRetryMs = 50, kLastRetryMs = 1000;
constexpr std::int64_t kDoubt_ns = 1'000'000'000;  // so long an incomplete message is believed without a look
constexpr std::int64_t kRateWindow_ns = 2'000'000'000;

struct Settings {
  std::string host, request_device;
  int port = 0;
  std::int64_t silence_ns = 0;  ///< 0: never
  std::uint64_t max_body_bytes = 0;
  std::vector<std::string> requests;
  int request_interval_ms = 0;
  std::string coordinate_system;
  Translator::Options translation;
};

/// STT_… asks for a stream, GET_… for one message.
bool is_request(const std::string& type) {
  for (const char* known : {"STT_TDATA", "STT_QTDATA", "GET_TRANSFORM", "GET_TRANS", "GET_IMAGE",
                            "GET_POLYDATA", "GET_STATUS", "GET_TDATA", "GET_QTDATA"})
    if (type == known) return true;
  return false;
}

Result<Settings> settings_from(const DeviceConfig& config) {
  SettingsReader reader(config);
  Settings s;
  s.host = reader.text("host").value_or("127.0.0.1");
  s.port = static_cast<int>(reader.number_in("port", 1, 65535, 18944));
  s.silence_ns = static_cast<std::int64_t>(reader.number_in("silence_s", 0, 3600, 5) * 1e9);
  s.max_body_bytes =
      static_cast<std::uint64_t>(reader.number_in("max_message_mib", 0.001, 1024, 64) * 1048576.0);
  s.requests = reader.texts("request").value_or(std::vector<std::string>{});
  for (const std::string& type : s.requests)
    if (!is_request(type))
      reader.refuse("request", fmt::format("names '{}'; as STT_TDATA or GET_POLYDATA", type));
  s.request_device = reader.text("request_device").value_or("");
  s.request_interval_ms = static_cast<int>(reader.number_in("request_interval_ms", 1, 3'600'000, 20));
  s.coordinate_system = reader.text("coordinate_system").value_or("");
  s.translation.name = config.stream;
  s.translation.reference = reader.text("reference").value_or("tracker");
  s.translation.latency_ns = static_cast<std::int64_t>(reader.number_in("latency_ms", 0, 10'000, 0) * 1e6);
  s.translation.decoding.normalise_quaternions = reader.flag("normalise_quaternions").value_or(false);
  const std::string ids = reader.choice("message_ids", {"stream", "connection", "ignore"}, "stream");
  s.translation.message_ids = ids == "stream"       ? igtl::MessageIds::kStream
                              : ids == "connection" ? igtl::MessageIds::kConnection
                                                    : igtl::MessageIds::kIgnore;
  GNATHION_CHECK_OK(reader.finish());
  return s;
}

class IgtlDevice : public Device {
 public:
  IgtlDevice(Settings settings, TcpClient client, Clock& clock)
      : settings_(std::move(settings)),
        client_(std::move(client)),
        clock_(clock),
        framer_(settings_.max_body_bytes),
        translator_(settings_.translation) {
    health_.message = "connecting to " + peer();
  }

  Result<std::optional<Sample>> next() override;
  DeviceDescription description() const override;
  DeviceHealth health() const override;
  void stop() override {
    stopped_ = true;
    client_.wake();
  }

 private:
  std::string peer() const { return fmt::format("{}:{}", settings_.host, settings_.port); }
  void try_to_connect();
  void read();
  bool send_requests();
  void drain_framer(HostTime arrival);
  void take(const igtl::Item& item, HostTime arrival);
  void doubt_the_incomplete(HostTime now);
  void lose(const std::string& why);
  void came_back();
  EventSample state_event(bool pressed, std::string text);
  void set_state(DeviceState state, std::string message);
  void count(const Sample& sample);

  const Settings settings_;
  TcpClient client_;
  Clock& clock_;
  std::atomic<bool> stopped_ = false;
  // Of the thread that calls next().
  Framer framer_;
  Translator translator_;
  std::deque<Sample> ready_;
  std::string bytes_;
  int retry_ms_ = kFirstRetryMs;
  bool heard_ = false, ever_heard_ = false, told_lost_ = false, wait_before_retry_ = false;
  HostTime last_bytes_;
  HostTime believed_from_;  ///< nothing was waiting, or what waits was looked through
  std::uint32_t events_ = 0;
  // Shared.
  mutable std::mutex mutex_;
  DeviceHealth health_;
  std::deque<std::int64_t> arrivals_ns_;
};

Result<std::optional<Sample>> IgtlDevice::next() {
  while (true) {
    if (!ready_.empty()) {
      Sample sample = std::move(ready_.front());
      ready_.pop_front();
      return std::optional<Sample>(std::move(sample));
    }
    if (stopped_) {
      client_.close();
      set_state(DeviceState::kStopped, "stopped");
      return std::optional<Sample>();
    }
    if (client_.connected())
      read();
    else
      try_to_connect();
  }
}

void IgtlDevice::try_to_connect() {
  if (wait_before_retry_) {
    wait_before_retry_ = false;
    if (client_.pause(retry_ms_) == SocketEvent::kWoken) return;
    retry_ms_ = std::min(2 * retry_ms_, kLastRetryMs);
  }
  if (client_.connect(kConnectMs) == SocketEvent::kDone) {
    framer_ = Framer(settings_.max_body_bytes);
    translator_.on_connect();
    heard_ = false;
    last_bytes_ = believed_from_ = clock_.now();
    if (send_requests()) {
      set_state(ever_heard_ ? DeviceState::kRecovering : DeviceState::kStarting,
                "connected to " + peer() + ", waiting for its first message");
      return;
    }
  }
  if (stopped_) return;
  lose(client_.fault());
}

bool IgtlDevice::send_requests() {
  for (const std::string& type : settings_.requests) {
    const bool starts = type.rfind("STT_", 0) == 0;
    const std::string body =
        starts ? igtl::start_tracking_body(settings_.request_interval_ms, settings_.coordinate_system) : "";
    if (client_.send(igtl::pack(type, settings_.request_device, body), kConnectMs) != SocketEvent::kDone)
      return false;
  }
  return true;
}

void IgtlDevice::read() {
  bytes_.clear();
  const SocketEvent event = client_.receive(bytes_, kWaitMs);
  const HostTime now = clock_.now();
  if (event == SocketEvent::kDone) {
    last_bytes_ = now;
    framer_.feed(bytes_);
    drain_framer(now);
  } else if (event == SocketEvent::kLost) {
    lose(client_.fault());
  } else if (settings_.silence_ns > 0 && now.ns - last_bytes_.ns > settings_.silence_ns) {
    lose(fmt::format("silent for {:.1f} s", static_cast<double>(now.ns - last_bytes_.ns) * 1e-9));
  }
  doubt_the_incomplete(now);
}

void IgtlDevice::drain_framer(HostTime arrival) {
  while (auto item = framer_.next()) {
    take(*item, arrival);
    believed_from_ = arrival;
  }
  if (framer_.waiting_bytes() == 0) believed_from_ = arrival;
  std::lock_guard lock(mutex_);
  health_.clock = translator_.clock();
}

void IgtlDevice::take(const igtl::Item& item, HostTime arrival) {
  if (item.kind == igtl::Item::Kind::kMessage && !heard_) came_back();
  for (Sample& sample : translator_.take(item, arrival)) {
    count(sample);
    ready_.push_back(std::move(sample));
  }
}

/// A wrong length would swallow small messages for hours, and bytes come, so that nothing is silent.
void IgtlDevice::doubt_the_incomplete(HostTime now) {
  if (now.ns - believed_from_.ns < kDoubt_ns) return;
  believed_from_ = now;
  if (const auto item = framer_.give_up_if_overtaken()) take(*item, now);
  drain_framer(now);
}

/// The first whole message on a connection: from now on the peer is there.
void IgtlDevice::came_back() {
  heard_ = true;
  retry_ms_ = kFirstRetryMs;
  if (told_lost_) ready_.push_back(state_event(true, "messages from " + peer()));
  {
    std::lock_guard lock(mutex_);
    if (ever_heard_ && told_lost_) ++health_.reconnects;
  }
  told_lost_ = false;
  ever_heard_ = true;
  set_state(DeviceState::kRunning, "connected to " + peer());
}

/// Ends the connection, gives out what is still whole, tells the loss once.
void IgtlDevice::lose(const std::string& why) {
  const bool was_heard = heard_;
  client_.close();
  framer_.finish();
  drain_framer(clock_.now());
  framer_ = Framer(settings_.max_body_bytes);
  if ((was_heard || heard_) || !told_lost_) ready_.push_back(state_event(false, peer() + ": " + why));
  told_lost_ = true;
  heard_ = false;
  set_state(ever_heard_ ? DeviceState::kRecovering : DeviceState::kStarting,
            fmt::format("{}: {}; trying again", peer(), why));
  wait_before_retry_ = true;
}

EventSample IgtlDevice::state_event(bool pressed, std::string text) {
  const HostTime now = clock_.now();
  return {
      {settings_.translation.name + "/state", events_++, now, now, {0}}, "device", pressed, std::move(text)};
}

void IgtlDevice::set_state(DeviceState state, std::string message) {
  std::lock_guard lock(mutex_);
  health_.state = state;
  health_.message = std::move(message);
}

void IgtlDevice::count(const Sample& sample) {
  std::lock_guard lock(mutex_);
  if (const auto* line = std::get_if<LedgerSample>(&sample)) {
    (line->fate == LedgerSample::Fate::kMissing ? health_.missing : health_.rejected) += line->count;
    return;
  }
  ++health_.received;
  arrivals_ns_.push_back(header_of(sample).arrival.ns);
  while (arrivals_ns_.front() < arrivals_ns_.back() - kRateWindow_ns) arrivals_ns_.pop_front();
}

DeviceHealth IgtlDevice::health() const {
  const std::int64_t since_ns = clock_.now().ns - kRateWindow_ns;
  std::lock_guard lock(mutex_);
  DeviceHealth health = health_;
  const auto recent =
      std::count_if(arrivals_ns_.begin(), arrivals_ns_.end(), [&](std::int64_t ns) { return ns > since_ns; });
  health.rate_hz = static_cast<double>(recent) / (static_cast<double>(kRateWindow_ns) * 1e-9);
  return health;
}

DeviceDescription IgtlDevice::description() const {
  DeviceDescription d;
  d.kind = kKind;
  d.stream = settings_.translation.name;
  d.vendor = "OpenIGTLink";
  d.model = peer();
  d.settings = {
      fmt::format("host: {}", settings_.host), fmt::format("port: {}", settings_.port),
      fmt::format("silence_s: {}", static_cast<double>(settings_.silence_ns) * 1e-9),
      fmt::format("max_message_mib: {:.3f}", static_cast<double>(settings_.max_body_bytes) / 1048576.0)};
  for (const std::string& type : settings_.requests) d.settings.push_back("request: " + type);
  return d;
}

}  // namespace

Result<std::unique_ptr<Device>> open_igtl_device(const DeviceConfig& config, Clock& clock) {
  GNATHION_TRY(Settings settings, settings_from(config));
  GNATHION_TRY(TcpClient client, TcpClient::create(settings.host, settings.port));
  return std::unique_ptr<Device>(std::make_unique<IgtlDevice>(std::move(settings), std::move(client), clock));
}

}  // namespace gnathion
