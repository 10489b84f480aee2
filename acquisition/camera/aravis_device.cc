#include "acquisition/camera/aravis_device.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <thread>

#include "acquisition/camera/aravis_camera.h"
#include "acquisition/camera/camera_feed.h"
#include "acquisition/camera/frame_counter.h"

namespace gnathion {

Result<AravisSettings> read_aravis_settings(const DeviceConfig& config) {
  SettingsReader reader(config);
  AravisSettings s;
  s.serial = reader.text("serial").value_or("");
  s.id = reader.text("id").value_or("");
  s.ip = reader.text("ip").value_or("");
  if (s.serial.empty() && s.id.empty() && s.ip.empty())
    reader.refuse("serial", "is not given, nor 'id' or 'ip': which camera is it?");
  const auto positive = [&](const char* key) {
    const auto value = reader.number(key);
    if (value && !(*value > 0)) reader.refuse(key, fmt::format("is {}; it must be above 0", *value));
    return value;
  };
  s.rate_hz = positive("rate_hz");
  s.exposure_us = positive("exposure_us");
  s.gain = reader.number("gain");
  reader.choice("pixel_format", {"Mono8"}, "Mono8");
  for (const auto& [key, value] :
       {std::pair{"width_px", &s.width_px}, std::pair{"height_px", &s.height_px}, std::pair{"x_px", &s.x_px},
        std::pair{"y_px", &s.y_px}, std::pair{"packet_size_bytes", &s.packet_size_bytes}})
    if (config.settings.count(key)) *value = static_cast<int>(reader.number_in(key, 0, 65535, 0));
  s.trigger = reader.text("trigger").value_or("free");
  s.latency_us = reader.number_in("latency_us", -1e6, 1e6, 0);
  s.buffers = static_cast<int>(reader.number_in("buffers", 2, 256, 16));
  s.queue_frames = static_cast<std::size_t>(reader.number_in("queue_frames", 2, 1000, 32));
  if (s.rate_hz && s.exposure_us && *s.exposure_us > 1e6 / *s.rate_hz)
    reader.refuse("rate_hz", fmt::format("is {}, but an exposure of {} us allows {:.1f} at most", *s.rate_hz,
                                         *s.exposure_us, 1e6 / *s.exposure_us));
  GNATHION_CHECK_OK(reader.finish());
  return s;
}

namespace {

using std::chrono::milliseconds;
constexpr int kPopMs = 100;

class AravisDevice : public Device {
 public:
  AravisDevice(AravisSettings settings, const DeviceConfig& config, Clock& clock)
      : s_(std::move(settings)),
        where_(config.where),
        stream_(config.stream),
        clock_(clock),
        feed_(config.stream, s_.queue_frames, CameraFeed::WhenFull::kReject),
        estimator_(clock_options()) {}

  ~AravisDevice() override {
    stop();
    if (thread_.joinable()) thread_.join();
  }

  Status open() {
    GNATHION_TRY(camera_, AravisCamera::open(s_, where_));
    describe();
    thread_ = std::thread([this] { run(); });
    return {};
  }

  Result<std::optional<Sample>> next() override { return feed_.next(); }
  DeviceHealth health() const override { return feed_.health(); }
  void stop() override { feed_.stop(); }
  DeviceDescription description() const override {
    std::lock_guard lock(description_mutex_);
    return description_;
  }

 private:
  ClockEstimator::Options clock_options() const {
    ClockEstimator::Options options;
    options.latency_ns = std::llround(s_.latency_us * 1e3);
    return options;
  }

  // The camera's thread.
  void run() {
    int silent_ms = 0;
    while (!feed_.stopping()) {
      HostTime arrival;
      auto buffer = camera_->next(kPopMs, clock_, &arrival);
      if (buffer) {
        if (silent_ms >= 2000) feed_.set_message("");
        silent_ms = 0;
        take(std::move(*buffer), arrival);
        continue;
      }
      silent_ms += kPopMs;
      const std::string why = why_lost(silent_ms);
      if (!why.empty()) {
        silent_ms = 0;
        if (!recover(why)) break;
      }
    }
    take_what_came();
    feed_.end();
    camera_.reset();
  }

  /// Frames that had arrived when the device was stopped.
  void take_what_came() {
    HostTime arrival;
    for (int i = 0; camera_ && i < s_.buffers; ++i) {
      auto buffer = camera_->next(0, clock_, &arrival);
      if (!buffer) return;
      take(std::move(*buffer), arrival);
    }
  }

  /// Control is lost when Aravis says so, or when frames stay away and the camera does not answer.
  std::string why_lost(int silent_ms) {
    if (camera_->control_lost()) return "control of the camera was lost";
    const bool triggered = camera_->rate_hz <= 0;
    // Ten periods at least: what restarts the camera must not come of one late frame.
    const int patience_ms = triggered ? 2000 : std::max(1000, static_cast<int>(10000 / camera_->rate_hz));
    if (silent_ms < patience_ms || silent_ms % patience_ms >= kPopMs) return "";
    if (!triggered) return fmt::format("no frames for {:.1f} s", silent_ms * 1e-3);
    if (!camera_->answers()) return "the camera does not answer";
    feed_.set_message(fmt::format("waits for a trigger on {}", s_.trigger));
    return "";
  }

  void take(AravisCamera::Buffer buffer, HostTime arrival) {
    SampleHeader header;
    header.stream = stream_;
    header.arrival = arrival;
    const FrameCounter::Place place = place_of(&buffer);
    set_capture(buffer, &header);
    header.sequence = place.sequence;
    if (place.missing > 0) {
      SampleHeader gap = header;
      gap.sequence -= place.missing;
      feed_.account({std::move(gap), LedgerSample::Fate::kMissing, place.missing, "counter gap"});
    }
    if (place.repeated) return account_repeated(std::move(header));
    if (!buffer.bad.empty())
      return feed_.account({std::move(header), LedgerSample::Fate::kRejected, 1, buffer.bad});
    feed_.deliver({std::move(header), std::move(buffer.image)});
  }

  /// A frame whose leader packet was lost comes in a buffer that still carries the number and the time of the
  /// frame before that (Aravis 0.8.26), or 0.
  FrameCounter::Place place_of(AravisCamera::Buffer* buffer) {
    if (buffer->bad.empty()) return counter_.take(buffer->frame_id);
    if (buffer->frame_id > 0)
      if (const FrameCounter::Place place = counter_.take(buffer->frame_id); !place.repeated) return place;
    buffer->device.reset();
    return counter_.take_unnumbered();
  }

  /// A number that is accounted for already is not a sensor frame more; it is told, without moving the
  /// counter.
  void account_repeated(SampleHeader header) {
    header.sequence = header.sequence > 0 ? header.sequence - 1 : 0;
    feed_.account({std::move(header), LedgerSample::Fate::kRejected, 1, "repeated counter"});
  }

  /// Mid-exposure on the host's clock. Incomplete frames have a timestamp only if their leader came; they do
  /// not teach the clock anything.
  void set_capture(const AravisCamera::Buffer& buffer, SampleHeader* header) {
    HostTime at{header->arrival.ns - std::llround(s_.latency_us * 1e3)};
    if (buffer.device) {
      header->device = *buffer.device;
      if (buffer.bad.empty()) {
        at = estimator_.add(*buffer.device, header->arrival);
        feed_.set_clock(estimator_.estimate());
      } else if (const auto known = estimator_.host_from_device(*buffer.device)) {
        at = *known;
      }
    }
    // What the estimate follows is the frame's arrival, which is after its exposure whatever the timestamp
    // marks.
    header->capture = HostTime{at.ns - std::llround(0.5e3 * camera_->exposure_us)};
  }

  bool recover(const std::string& why) {
    feed_.lost(clock_.now(), why);
    camera_.reset();
    milliseconds wait(100);
    while (feed_.pause(wait)) {
      auto again = AravisCamera::open(s_, where_);
      if (!again) {
        wait = std::min(2 * wait, milliseconds(1000));
        continue;
      }
      camera_ = std::move(*again);
      counter_.restart();
      describe();
      feed_.back(clock_.now(), fmt::format("camera {} is back", camera_->serial));
      return true;
    }
    return false;
  }

  void describe() {
    DeviceDescription d;
    d.kind = "aravis";
    d.stream = stream_;
    d.vendor = camera_->vendor;
    d.model = camera_->model;
    d.serial = camera_->serial;
    d.settings = camera_->setting_lines;
    d.warnings = camera_->warning_lines;
    d.settings.push_back(
        fmt::format("capture time: the camera's timestamps mapped to arrival, less latency {} us and half of "
                    "exposure {} us",
                    s_.latency_us, camera_->exposure_us));
    std::lock_guard lock(description_mutex_);
    description_ = std::move(d);
  }

  const AravisSettings s_;
  const std::string where_, stream_;
  Clock& clock_;
  CameraFeed feed_;
  mutable std::mutex description_mutex_;
  DeviceDescription description_;
  // Of the camera's thread, once it runs.
  std::unique_ptr<AravisCamera> camera_;
  ClockEstimator estimator_;
  FrameCounter counter_;
  std::thread thread_;
};

}  // namespace

Result<std::unique_ptr<Device>> open_aravis_device(const DeviceConfig& config, Clock& clock) {
  GNATHION_TRY(AravisSettings settings, read_aravis_settings(config));
  auto device = std::make_unique<AravisDevice>(std::move(settings), config, clock);
  GNATHION_CHECK_OK(device->open());
  return device;
}

}  // namespace gnathion
