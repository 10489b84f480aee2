#include "acquisition/camera/capture_device.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <thread>

#include "acquisition/camera/camera_feed.h"
#include "acquisition/camera/capture_settings.h"
#include "acquisition/camera/frame_counter.h"
#include "acquisition/camera/frame_reader.h"

namespace gnathion {
namespace {

using Backend = CaptureSettings::Backend;
using std::chrono::milliseconds;
constexpr double kWarmUpS = 1.0;

std::string first_line(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

Result<std::unique_ptr<FrameReader>> open_reader(const CaptureSettings& settings, const std::string& where) {
  return settings.backend == Backend::kFolder ? open_folder(settings, where) : open_video(settings, where);
}

class CaptureDevice : public Device {
 public:
  CaptureDevice(CaptureSettings settings, const DeviceConfig& config, Clock& clock)
      : s_(std::move(settings)),
        where_(config.where),
        stream_(config.stream),
        clock_(clock),
        feed_(config.stream, s_.queue_frames,
              s_.live() ? CameraFeed::WhenFull::kReject : CameraFeed::WhenFull::kWait),
        estimator_(clock_options(s_)) {}

  ~CaptureDevice() override {
    stop();
    if (thread_.joinable()) thread_.join();
  }

  Status open() {
    GNATHION_TRY(reader_, open_reader(s_, where_));
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
  static ClockEstimator::Options clock_options(const CaptureSettings& s) {
    ClockEstimator::Options options;
    options.latency_ns = std::llround(s.latency_us * 1e3);
    return options;
  }

  // The camera's thread.
  void run() {
    for (;;) {
      ReadFrame frame;
      HostTime arrival;
      if (feed_.stopping()) return release(), feed_.end();
      const FrameReader::Outcome outcome = reader_->read(clock_, &arrival, &frame);
      if (outcome == FrameReader::Outcome::kFrame) take(std::move(frame), arrival);
      if (outcome == FrameReader::Outcome::kEnd) return end_of_file();
      if (outcome == FrameReader::Outcome::kLost && !recover()) return feed_.end();
    }
  }

  void take(ReadFrame frame, HostTime arrival) {
    SampleHeader header;
    header.stream = stream_;
    if (frame.bad.empty()) frame.bad = wrong_size(frame.image);
    set_times(frame, arrival, &header);
    const FrameCounter::Place place = counter_.take_next(frame.skipped);
    header.sequence = place.sequence;
    if (place.missing > 0) account_missing(header, place.missing);
    if (!frame.bad.empty()) return give(LedgerSample{header, LedgerSample::Fate::kRejected, 1, frame.bad});
    give(FrameSample{std::move(header), std::move(frame.image)});
  }

  /// FFmpeg holds the first frames of a URL back and gives them all at once. Only after a while is it known
  /// when they were captured; until then they wait here.
  void give(Sample sample) {
    const HostTime now = header_of(sample).arrival;
    if (!warm_from_) warm_from_ = now;
    const bool cold =
        s_.backend == Backend::kUrl && s_.device_clock && now.seconds_since(*warm_from_) < kWarmUpS;
    if (held_.empty() && !cold) return hand_over(std::move(sample));
    held_.push_back(std::move(sample));
    if (!cold || held_.size() >= s_.queue_frames) release();
  }
  void release() {
    for (Sample& sample : held_) {
      SampleHeader& header = std::visit([](auto& x) -> SampleHeader& { return x.header; }, sample);
      if (const auto host = estimator_.host_from_device(header.device))
        header.capture = mid_exposure(std::min(*host, header.arrival));
      hand_over(std::move(sample));
    }
    held_.clear();
  }
  void hand_over(Sample sample) {
    if (auto* line = std::get_if<LedgerSample>(&sample)) return feed_.account(std::move(*line));
    feed_.deliver(std::move(std::get<FrameSample>(sample)));
  }

  void account_missing(SampleHeader header, std::uint32_t count) {
    header.sequence -= count;
    give(LedgerSample{std::move(header), LedgerSample::Fate::kMissing, count,
                      s_.backend == Backend::kFolder ? "counter gap" : "gap in presentation times"});
  }

  /// A frame of another size than the first does not fit the camera's calibration.
  std::string wrong_size(const Image8& image) {
    if (width_px_ == 0) width_px_ = image.width_px, height_px_ = image.height_px;
    if (image.width_px == width_px_ && image.height_px == height_px_) return "";
    return fmt::format("size {}x{} px instead of {}x{}", image.width_px, image.height_px, width_px_,
                       height_px_);
  }

  /// Recordings: capture = arrival = presentation time from 0, so that every run gives the same. Cameras: a
  /// frame arrives after its last row was exposed and read, whatever instant the driver stamps; mid-exposure
  /// of the middle row is half an exposure and half a readout before.
  void set_times(const ReadFrame& frame, HostTime arrival, SampleHeader* header) {
    if (frame.device) header->device = *frame.device;
    if (!s_.live()) {
      header->capture = header->arrival = HostTime{header->device.ns - std::llround(s_.latency_us * 1e3)};
      return;
    }
    header->arrival = arrival;
    HostTime at{arrival.ns - std::llround(s_.latency_us * 1e3)};
    if (frame.device) {
      at = estimator_.add(*frame.device, arrival);
      feed_.set_clock(estimator_.estimate());
    }
    header->capture = mid_exposure(at);
  }

  HostTime mid_exposure(HostTime exposed_and_read) const {
    const double rows = height_px_ > 1 ? height_px_ - 1 : 0;
    const double before_us = 0.5 * (s_.line_time_us.value_or(0) * rows + reader_->exposure_us);
    return {exposed_and_read.ns - std::llround(before_us * 1e3)};
  }

  void end_of_file() {
    if (const std::uint32_t missing = reader_->short_of()) {
      SampleHeader header;
      header.stream = stream_;
      header.sequence = counter_.take_next(0).sequence;
      feed_.account({header, LedgerSample::Fate::kMissing, missing, "announced by the file, not in it"});
    }
    feed_.end();
  }

  /// Waits until the camera is there again; false when the device is to stop. Presentation times of a new
  /// connection start anew.
  bool recover() {
    release();
    warm_from_.reset();
    feed_.lost(clock_.now(), fmt::format("{} gives no frames any more; trying again", s_.shown));
    milliseconds wait(50);
    while (feed_.pause(wait)) {
      reader_.reset();  // a camera cannot be opened twice
      auto again = open_reader(s_, where_);
      if (!again) {
        wait = std::min(2 * wait, milliseconds(2000));
        continue;
      }
      reader_ = std::move(*again);
      estimator_ = ClockEstimator(clock_options(s_));
      describe();
      feed_.back(clock_.now(), s_.shown + " is back");
      return true;
    }
    return false;
  }

  void describe() {
    DeviceDescription d;
    d.kind = "camera";
    d.stream = stream_;
    d.settings = reader_->setting_lines;
    d.warnings = reader_->warning_lines;
    d.settings.insert(d.settings.begin(), "source: " + s_.shown);
    if (reader_->rate_hz() > 0)
      d.settings.push_back(fmt::format("nominal rate_hz: {:.3f}", reader_->rate_hz()));
    d.settings.push_back("capture time: " + time_text());
    if (s_.backend == Backend::kV4l2) describe_v4l2(&d);
    if (s_.live()) describe_shutter(&d);
    std::lock_guard lock(description_mutex_);
    description_ = std::move(d);
  }

  std::string time_text() const {
    if (!s_.live()) return "presentation time from 0, taken as mid-exposure";
    const std::string base = s_.device_clock ? "presentation times mapped to the host's clock" : "arrival";
    return fmt::format(
        "{}, less latency {} us, half of exposure {}{}", base, s_.latency_us,
        reader_->exposure_us > 0 ? fmt::format("{} us", reader_->exposure_us) : "(not known: taken as 0)",
        s_.line_time_us ? " and half of the readout" : "");
  }

  void describe_v4l2(DeviceDescription* d) const {
    std::error_code error;
    const std::filesystem::path node = std::filesystem::canonical(s_.source, error);
    const std::filesystem::path sys = std::filesystem::path("/sys/class/video4linux") / node.filename();
    d->model = first_line(sys / "name");
    d->vendor = first_line(sys / "device/../manufacturer");
    d->serial = first_line(sys / "device/../serial");
  }

  void describe_shutter(DeviceDescription* d) const {
    switch (s_.shutter) {
      case CaptureSettings::Shutter::kGlobal:
        d->settings.push_back("shutter: global");
        break;
      case CaptureSettings::Shutter::kRolling:
        d->settings.push_back(
            fmt::format("shutter: rolling, line time {}",
                        s_.line_time_us ? fmt::format("{} us", *s_.line_time_us) : "not given"));
        d->warnings.push_back(s_.line_time_us
                                  ? "rolling shutter: rows are exposed one after another; capture times "
                                    "are of the middle row"
                                  : "rolling shutter without line_time_us: capture times are of the "
                                    "last row");
        break;
      case CaptureSettings::Shutter::kUnknown:
        d->warnings.push_back(
            "shutter not stated: most such cameras have a rolling shutter, which bends what moves; set "
            "shutter = "
            "\"rolling\" or \"global\"");
        break;
    }
  }

  const CaptureSettings s_;
  const std::string where_, stream_;
  Clock& clock_;
  CameraFeed feed_;
  mutable std::mutex description_mutex_;
  DeviceDescription description_;
  // Of the camera's thread, once it runs.
  std::unique_ptr<FrameReader> reader_;
  ClockEstimator estimator_;
  FrameCounter counter_;
  int width_px_ = 0, height_px_ = 0;
  std::optional<HostTime> warm_from_;
  std::vector<Sample> held_;
  std::thread thread_;
};

}  // namespace

Result<std::unique_ptr<Device>> open_capture_device(const DeviceConfig& config, Clock& clock) {
  GNATHION_TRY(CaptureSettings settings, read_capture_settings(config));
  auto device = std::make_unique<CaptureDevice>(std::move(settings), config, clock);
  GNATHION_CHECK_OK(device->open());
  return device;
}

}  // namespace gnathion
