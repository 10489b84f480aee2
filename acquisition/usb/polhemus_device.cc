#include "acquisition/usb/polhemus_device.h"

#include <fmt/format.h>

#include <map>

#include "acquisition/recording.h"
#include "acquisition/usb/polhemus_protocol.h"
#include "acquisition/usb/transfer_device.h"
#include "acquisition/usb/usb_transport.h"

namespace gnathion {
namespace {

using std::chrono::milliseconds;

constexpr std::uint16_t kVendor = 0x0f44;
constexpr UsbProduct kPatriot[] = {{kVendor, 0xef12, "PATRIOT"},
                                   {kVendor, 0xef20, "PATRIOT HS"},
                                   {kVendor, 0xef11, "PATRIOT", true},
                                   {kVendor, 0xef21, "PATRIOT HS", true}};
constexpr UsbProduct kLiberty[] = {{kVendor, 0xff12, "LIBERTY"},
                                   {kVendor, 0xff20, "LIBERTY"},
                                   {kVendor, 0xff11, "LIBERTY", true},
                                   {kVendor, 0xff21, "LIBERTY", true}};
constexpr double kPatriotRateHz = 60, kLibertyRateHz = 240;
constexpr double kMmPerCm = 10;
constexpr std::string_view kPoll = "P", kBinary = "F1\r", kCentimetres = "U1\r", kContinuous = "C\r";
constexpr std::string_view kAskStations =
    "\x15"
    "0\r";  // ^U: which stations are detected and active
constexpr std::uint8_t kStations = 0x15;
/// ^R and ^B: poses in the transmitter's own frame and of the sensor's own axes, whatever was stored.
constexpr const char* kOwnFrames[] = {"\x12*\r", "\x02*\r"};
constexpr milliseconds kQuiet{50}, kPatience{2000};
constexpr std::int32_t kReordered = 64;  // frames: a counter that falls by more was started anew

struct PolhemusSettings {
  PolhemusFormat format;
  std::optional<std::int64_t> distortion_limit;
  std::optional<double> rate_hz;
  std::vector<std::string> commands;  ///< besides those that fix format and unit
  milliseconds longest_silence{1000};
  ClockEstimator::Options clock;
};

/// "^R*" for the bytes of that command.
std::string printable(const std::string& command) {
  std::string text;
  for (const char c : command) {
    if (c == '\r') continue;
    if (static_cast<unsigned char>(c) < 0x20)
      text += {'^', static_cast<char>(c + '@')};
    else
      text += c;
  }
  return text;
}

/// Product number in a device descriptor (USB 2.0, table 9-8).
std::uint16_t product_in(const std::string& descriptor) {
  if (descriptor.size() < 12) return 0;
  return static_cast<std::uint16_t>(static_cast<unsigned char>(descriptor[10]) |
                                    (static_cast<unsigned char>(descriptor[11]) << 8));
}

/// "1, 2" from the answer to ^U: two bit maps (u16), detected and active.
std::string sensors_in(const std::string& body) {
  std::vector<int> numbers;
  for (int bit = 0; bit < 16 && body.size() >= 4; ++bit)
    if (static_cast<unsigned char>(body[2 + bit / 8]) >> (bit % 8) & 1) numbers.push_back(bit + 1);
  return fmt::format("{}", fmt::join(numbers, ", "));
}

class PolhemusSession : public TransferSession {
 public:
  PolhemusSession(std::string stream, std::string where, PolhemusSettings settings)
      : TransferSession(std::move(stream)),
        where_(std::move(where)),
        settings_(std::move(settings)),
        decoder_(settings_.format),
        clock_(settings_.clock),
        timer_(settings_.rate_hz.value_or(kLibertyRateHz)) {}

  Status start(TransferIo& io) override;
  void stop(TransferIo& io) override { io.write(kPoll); }
  milliseconds longest_silence() const override { return settings_.longest_silence; }
  ClockEstimate clock() const override { return clock_.estimate(); }
  std::vector<std::string> facts() const override;
  std::vector<std::string> warnings() const override;

 protected:
  void opened(const TransferSample& descriptors, std::deque<Sample>& out) override;
  void sent(const TransferSample& transfer, std::deque<Sample>& out) override;
  void received(const TransferSample& transfer, std::deque<Sample>& out) override;
  void lost(const TransferSample& transfer, std::deque<Sample>& out) override;
  void ended(std::deque<Sample>& out) override;

 private:
  struct Station {
    std::uint32_t frame = 0;
    bool reopened = false;  ///< its counter may have started anew
    SampleHeader last;
  };
  tl::unexpected<Error> failed(const std::string& why) const {
    return fail(ErrorCode::kInternal, "cannot start Polhemus tracker", where_, why);
  }
  Result<PolhemusReply> stations_reply(TransferIo& io);
  void take(const PolhemusRecord& record, const SampleHeader& at, std::deque<Sample>& out);
  void take(const PolhemusPose& pose, const SampleHeader& at, std::deque<Sample>& out);
  bool in_order(Station* station, const SampleHeader& at, std::deque<Sample>& out);
  void restart_timer();
  void missing(const Station& station, std::uint32_t count, const SampleHeader& at, std::deque<Sample>& out);
  void flush(const SampleHeader& at, std::deque<Sample>& out);
  std::string why_invalid(const PolhemusPose& pose) const;

  std::string where_;
  PolhemusSettings settings_;
  PolhemusDecoder decoder_;
  bool streaming_ = false;
  std::vector<PolhemusReply> replies_;  ///< since the stream was stopped
  std::string sensors_;
  double rate_hz_ = kLibertyRateHz;
  ClockEstimator clock_;
  PolhemusFrameTimer timer_;
  std::optional<std::uint32_t> timed_frame_;
  DeviceTime device_time_;
  HostTime capture_;
  std::map<int, Station> stations_;
  SampleHeader last_;
};

/// Stopped, set up, asked for its sensors, started. Refusals of settings come before the answer to the
/// question, since the tracker answers in order.
Status PolhemusSession::start(TransferIo& io) {
  if (!io.write(kPoll)) return failed("it does not take commands");
  milliseconds waited{0};
  while (io.read(kQuiet) && waited < kPatience && !io.stopping()) waited += kQuiet;
  replies_.clear();
  std::vector<std::string> commands = {std::string(kBinary), std::string(kCentimetres),
                                       settings_.format.command()};
  commands.insert(commands.end(), settings_.commands.begin(), settings_.commands.end());
  for (const std::string& command : commands)
    if (!io.write(command))
      return failed(fmt::format("it does not take the command '{}'", printable(command)));
  GNATHION_TRY(const PolhemusReply stations, stations_reply(io));
  for (const PolhemusReply& reply : replies_)
    if (const auto error = polhemus_error(reply.error); error && reply.command != kPoll[0])
      return failed(fmt::format("it refuses the command '{}': {}",
                                printable(std::string(1, static_cast<char>(reply.command))), *error));
  sensors_ = sensors_in(stations.body);
  if (sensors_.empty()) return failed("no sensor is connected to it");
  if (!io.write(kContinuous)) return failed("it does not take the command 'C'");
  return {};
}

Result<PolhemusReply> PolhemusSession::stations_reply(TransferIo& io) {
  if (!io.write(kAskStations)) return failed("it does not take commands");
  for (milliseconds waited{0}; waited < kPatience && !io.stopping();) {
    waited += io.read(kQuiet) ? milliseconds(1) : kQuiet;  // it may go on sending something else for ever
    for (const PolhemusReply& reply : replies_)
      if (reply.command == kStations) return reply;
  }
  return failed("it does not answer");
}

std::vector<std::string> PolhemusSession::facts() const {
  return {fmt::format("sensors: {}", sensors_), fmt::format("rate_hz: {:g}", rate_hz_)};
}

std::vector<std::string> PolhemusSession::warnings() const {
  if (timer_.rate_holds()) return {};
  return {fmt::format(
      "the time stamps contradict {:g} frames a second; set rate_hz (times are good to 0.5 ms only)",
      rate_hz_)};
}

void PolhemusSession::opened(const TransferSample& descriptors, std::deque<Sample>&) {
  const std::uint16_t product = product_in(descriptors.data);
  const bool patriot = product == kPatriot[0].product || product == kPatriot[1].product;
  rate_hz_ = settings_.rate_hz.value_or(patriot ? kPatriotRateHz : kLibertyRateHz);
  decoder_ = PolhemusDecoder(settings_.format);
  streaming_ = false;
  last_ = descriptors.header;
  for (auto& [number, station] : stations_) station.reopened = true;
  restart_timer();
}

/// The estimator notices by itself that the device's clock has jumped, and keeps captures in order.
void PolhemusSession::restart_timer() {
  timer_ = PolhemusFrameTimer(rate_hz_);
  timed_frame_.reset();
}

void PolhemusSession::sent(const TransferSample& transfer, std::deque<Sample>& out) {
  if (transfer.data == kPoll) {
    flush(transfer.header, out);
    streaming_ = false;
  }
  if (transfer.data == kContinuous) {
    decoder_ = PolhemusDecoder(settings_.format);
    streaming_ = true;
    tell_working(transfer.header.arrival, out);
  }
}

void PolhemusSession::received(const TransferSample& transfer, std::deque<Sample>& out) {
  last_ = transfer.header;
  std::vector<PolhemusRecord> records;
  decoder_.feed(transfer.data, records);
  for (const PolhemusRecord& record : records) take(record, transfer.header, out);
}

void PolhemusSession::take(const PolhemusRecord& record, const SampleHeader& at, std::deque<Sample>& out) {
  if (!streaming_) {  // answers to commands, and what the tracker still had to send
    if (const auto* reply = std::get_if<PolhemusReply>(&record)) replies_.push_back(*reply);
    return;
  }
  if (const auto* pose = std::get_if<PolhemusPose>(&record)) return take(*pose, at, out);
  if (const auto* garbage = std::get_if<PolhemusGarbage>(&record))
    out.emplace_back(rejected(stream(), at, fmt::format("garbage: {} bytes", garbage->bytes)));
  if (const auto* reply = std::get_if<PolhemusReply>(&record))
    out.emplace_back(rejected(
        stream(), at, fmt::format("tracker says: {}", polhemus_error(reply->error).value_or("no error"))));
}

void PolhemusSession::take(const PolhemusPose& pose, const SampleHeader& at, std::deque<Sample>& out) {
  PoseSample sample;
  sample.header = at;
  sample.header.stream = fmt::format("{}/{}", stream(), pose.station);
  sample.header.sequence = pose.frame;
  const auto [found, first] = stations_.try_emplace(pose.station);
  Station& station = found->second;
  station.last = sample.header;
  if (first)
    station.frame = pose.frame;
  else if (!in_order(&station, sample.header, out))
    return;
  if (timed_frame_ != pose.frame) {  // all sensors of a frame are measured at once
    timed_frame_ = pose.frame;
    device_time_ = {timer_.time_ns(pose.time_ms, pose.frame)};
    capture_ = clock_.add(device_time_, at.arrival);
  }
  sample.header.device = device_time_;
  sample.header.capture = capture_;
  sample.reference = "transmitter";
  sample.body = fmt::format("sensor_{}", pose.station);
  sample.reason = why_invalid(pose);
  sample.valid = sample.reason.empty();
  if (is_plausible(pose)) {
    const Eigen::Quaterniond q(
        static_cast<double>(pose.quaternion[0]), static_cast<double>(pose.quaternion[1]),
        static_cast<double>(pose.quaternion[2]), static_cast<double>(pose.quaternion[3]));
    sample.reference_from_body.rotation = q.normalized().toRotationMatrix();
    for (int i = 0; i < 3; ++i)
      sample.reference_from_body.translation_mm[i] = kMmPerCm * static_cast<double>(pose.position_cm[i]);
  }
  out.emplace_back(std::move(sample));
}

/// Holds a frame's counter against the last of its sensor. What is not in order is told and left out; the raw
/// stream keeps it.
bool PolhemusSession::in_order(Station* station, const SampleHeader& at, std::deque<Sample>& out) {
  const std::uint32_t frame = at.sequence;
  const auto step = static_cast<std::int32_t>(frame - station->frame);
  if (step == 0) {
    out.emplace_back(rejected(at.stream, at, "duplicate"));
    return false;
  }
  if (step < 0 && step > -kReordered && !station->reopened) {
    out.emplace_back(
        rejected(at.stream, at, fmt::format("out of order: frame {} after {}", frame, station->frame)));
    return false;
  }
  if (step > 1) missing(*station, static_cast<std::uint32_t>(step - 1), at, out);
  if (step < 0 && timed_frame_ && static_cast<std::int32_t>(frame - *timed_frame_) < 0) {
    restart_timer();
    tell_state(at.arrival, true, "the tracker's frame counter started anew", out);
  }
  station->reopened = false;
  station->frame = frame;
  return true;
}

void PolhemusSession::missing(const Station& station, std::uint32_t count, const SampleHeader& at,
                              std::deque<Sample>& out) {
  LedgerSample line;
  line.header = at;
  line.header.stream = station.last.stream;
  line.header.sequence = station.frame + 1;
  line.fate = LedgerSample::Fate::kMissing;
  line.count = count;
  line.reason = "counter gap";
  out.emplace_back(std::move(line));
}

std::string PolhemusSession::why_invalid(const PolhemusPose& pose) const {
  if (const auto error = polhemus_error(pose.error)) return *error;
  if (!is_plausible(pose)) return "not a position and a unit quaternion";
  if (settings_.distortion_limit && pose.distortion > *settings_.distortion_limit)
    return fmt::format("distortion {} above {}", pose.distortion, *settings_.distortion_limit);
  return {};
}

/// What is left in the decoder belongs to no record any more, and sensors that fell behind stay so.
void PolhemusSession::flush(const SampleHeader& at, std::deque<Sample>& out) {
  std::vector<PolhemusRecord> rest;
  decoder_.flush(rest);
  for (const PolhemusRecord& record : rest) take(record, at, out);
}

void PolhemusSession::lost(const TransferSample& transfer, std::deque<Sample>& out) {
  flush(transfer.header, out);
  streaming_ = false;
}

void PolhemusSession::ended(std::deque<Sample>& out) {
  flush(last_, out);
  std::optional<std::uint32_t> newest;
  for (const auto& [number, station] : stations_)
    if (!newest || static_cast<std::int32_t>(station.frame - *newest) > 0) newest = station.frame;
  for (auto& [number, station] : stations_)
    if (station.frame != *newest) {
      missing(station, *newest - station.frame, station.last, out);
      station.frame = *newest;
    }
}

struct PolhemusConfig {
  std::vector<UsbProduct> products;
  InstrumentChoice choice;
  PolhemusSettings settings;
  bool wait = false;
  std::optional<std::filesystem::path> replay;
  DeviceDescription description;
};

void read_geometry(SettingsReader& reader, PolhemusConfig& config) {
  if (const auto zenith = reader.numbers("hemisphere")) {
    if (zenith->size() != 3)
      reader.refuse("hemisphere", "must be a direction: 3 numbers");
    else
      config.settings.commands.push_back(
          fmt::format("H*,{:g},{:g},{:g}\r", (*zenith)[0], (*zenith)[1], (*zenith)[2]));
  }
  if (const auto points = reader.numbers("alignment_mm")) {
    if (points->size() != 9) {
      reader.refuse("alignment_mm",
                    "must be 3 points: origin, one on the x axis, one on the y side; 9 numbers");
    } else {
      std::string command = "A*";
      for (const double mm : *points) command += fmt::format(",{:.4f}", mm / kMmPerCm);
      config.settings.commands.push_back(command + "\r");
    }
  }
}

Result<PolhemusConfig> read_config(const DeviceConfig& from) {
  SettingsReader reader(from);
  PolhemusConfig config;
  const std::string product = reader.choice("product", {"any", "patriot", "liberty"}, "any");
  if (product != "liberty")
    config.products.insert(config.products.end(), std::begin(kPatriot), std::end(kPatriot));
  if (product != "patriot")
    config.products.insert(config.products.end(), std::begin(kLiberty), std::end(kLiberty));
  config.choice = {reader.text("serial"), reader.text("port"), std::nullopt};
  config.settings.commands.assign(std::begin(kOwnFrames), std::end(kOwnFrames));
  read_geometry(reader, config);
  const std::string filter = reader.choice("filter", {"off", "keep"}, "off");
  if (filter == "off")
    config.settings.commands.insert(config.settings.commands.end(), {"X0,1,0,0\r", "Y0,1,0,0\r"});
  if (const auto limit = reader.integer("distortion_limit")) {
    config.settings.distortion_limit = *limit;
    config.settings.format.distortion = true;
  }
  const double rate = reader.number_in("rate_hz", 1, 1000, 0);
  if (rate > 0) config.settings.rate_hz = rate;
  config.settings.clock.latency_ns =
      static_cast<std::int64_t>(reader.number_in("latency_ms", 0, 1000, 0) * 1e6);
  config.settings.longest_silence =
      milliseconds(static_cast<std::int64_t>(reader.number_in("longest_silence_ms", 100, 60000, 1000)));
  config.wait = reader.flag("wait").value_or(false);
  config.replay = reader.path("replay");
  GNATHION_CHECK_OK(reader.finish());
  config.description.kind = from.kind;
  config.description.stream = from.stream;
  config.description.settings = {"unit: centimetres (delivered in mm)", "quaternion: w x y z",
                                 fmt::format("filter: {}", filter)};
  for (const std::string& command : config.settings.commands)
    config.description.settings.push_back(fmt::format("command: {}", printable(command)));
  return config;
}

std::unique_ptr<PolhemusSession> session_of(const DeviceConfig& from, const PolhemusConfig& config) {
  return std::make_unique<PolhemusSession>(from.stream, from.where, config.settings);
}

}  // namespace

Result<std::unique_ptr<Device>> open_polhemus(const DeviceConfig& from, Clock& clock) {
  GNATHION_TRY(PolhemusConfig config, read_config(from));
  if (config.replay) {
    GNATHION_TRY(std::unique_ptr<Source> recording, RecordingSource::open(*config.replay));
    return replay_polhemus(from, std::move(recording));
  }
  GNATHION_TRY(auto finder, find_usb(config.products, config.choice, "Polhemus tracker", from.where, clock));
  GNATHION_TRY(auto device, TransferDevice::open(config.description, std::move(finder),
                                                 session_of(from, config), config.wait, clock));
  return device;
}

Result<std::unique_ptr<Device>> replay_polhemus(const DeviceConfig& from, std::unique_ptr<Source> recording) {
  GNATHION_TRY(PolhemusConfig config, read_config(from));
  return std::make_unique<TransferReplay>(config.description, std::move(recording), session_of(from, config));
}

}  // namespace gnathion
