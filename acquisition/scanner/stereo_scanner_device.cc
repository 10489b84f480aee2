#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <thread>

#include "acquisition/scanner/frame_pairs.h"
#include "acquisition/scanner/scan_devices.h"
#include "acquisition/scanner/scan_outbox.h"
#include "acquisition/scanner/stereo_surface.h"
#include "core/file.h"

namespace gnathion {
namespace {

using std::chrono::milliseconds;

struct StereoSettings {
  RigCamera cameras[2];
  StereoOptions options;
  enum class Trigger { kOnce, kInterval, kRequest } trigger = Trigger::kRequest;
  double interval_s = 10, timeout_s = 5;
  std::int64_t max_skew_ns = 0;
  int warm_up_frames = 0;
  bool live = true;  ///< frames count only when they were captured after the request
  std::filesystem::path rig;
};

/// Keys of the cameras themselves: "first_source", "second_source", "both_exposure_us".
bool belongs_to_camera(const std::string& key) {
  for (const char* prefix : {"first_", "second_", "both_"})
    if (key.rfind(prefix, 0) == 0) return true;
  return false;
}

DeviceConfig camera_config(const DeviceConfig& config, const std::string& which, const std::string& kind) {
  DeviceConfig camera;
  camera.kind = kind;
  camera.stream = config.stream + "_" + which;
  camera.where = config.where + ": " + which + " camera";
  camera.folder = config.folder;
  for (const auto& [key, value] : config.settings)
    for (const std::string& prefix : {std::string("both_"), which + "_"})
      if (key.rfind(prefix, 0) == 0) camera.settings[key.substr(prefix.size())] = value;
  return camera;
}

Result<RigCamera> camera_named(const std::vector<RigCamera>& cameras, const std::string& name,
                               const std::string& where) {
  for (const RigCamera& camera : cameras)
    if (camera.name == name) return camera;
  std::vector<std::string> names;
  for (const RigCamera& camera : cameras) names.push_back(camera.name);
  return bad_input("cannot open device", where,
                   fmt::format("the rig has no camera '{}'; it has {}", name, fmt::join(names, ", ")));
}

Result<StereoSettings> settings_from(const DeviceConfig& config, std::string* camera_kind) {
  DeviceConfig own = config;
  std::erase_if(own.settings, [](const auto& entry) { return belongs_to_camera(entry.first); });
  SettingsReader read(own);
  StereoSettings s;
  s.rig = read.path("rig").value_or(std::filesystem::path());
  if (s.rig.empty()) read.refuse("rig", "is missing: the RIG.toml with both cameras' calibration");
  const auto names = read.texts("cameras");
  if (names && names->size() != 2) read.refuse("cameras", "needs two names of the rig's cameras");
  *camera_kind = read.choice("camera_kind", {"camera", "aravis"}, "camera");
  const std::string trigger = read.choice("trigger", {"once", "interval", "request"}, "request");
  s.trigger = trigger == "once"       ? StereoSettings::Trigger::kOnce
              : trigger == "interval" ? StereoSettings::Trigger::kInterval
                                      : StereoSettings::Trigger::kRequest;
  s.interval_s = read.number_in("interval_s", 0.05, 3600, 10);
  s.timeout_s = read.number_in("timeout_s", 0.1, 600, 5);
  s.max_skew_ns = static_cast<std::int64_t>(read.number_in("max_skew_ms", 0, 1000, 10) * 1e6);
  s.warm_up_frames = static_cast<int>(read.number_in("warm_up_frames", 0, 1000, 0));
  s.live = read.flag("live").value_or(true);
  s.options.near_mm = read.number_in("near_mm", 50, 3000, s.options.near_mm);
  s.options.far_mm = read.number_in("far_mm", 50, 3000, s.options.far_mm);
  if (s.options.far_mm <= s.options.near_mm) read.refuse("far_mm", "must be larger than near_mm");
  s.options.step_px = static_cast<int>(read.number_in("step_px", 1, 8, s.options.step_px));
  s.options.max_disparity_sigma_px =
      read.number_in("max_disparity_sigma_px", 0.02, 2, s.options.max_disparity_sigma_px);
  GNATHION_CHECK_OK(read.finish());
  GNATHION_TRY(const std::vector<RigCamera> cameras, read_rig_cameras(s.rig));
  if (!names && cameras.size() != 2)
    return bad_input("cannot open device", config.where,
                     fmt::format("the rig has {} cameras; 'cameras' must name two", cameras.size()));
  for (std::size_t k = 0; k < 2; ++k) {
    GNATHION_TRY(s.cameras[k], camera_named(cameras, names ? (*names)[k] : cameras[k].name, config.where));
  }
  return s;
}

std::string png_of(const Image8& image) {
  const cv::Mat view(image.height_px, image.width_px, CV_8U, const_cast<std::uint8_t*>(image.pixels.data()));
  std::vector<std::uint8_t> bytes;
  cv::imencode(".png", view, bytes);
  return std::string(bytes.begin(), bytes.end());
}

class StereoScannerDevice : public Device, public ScanOnRequest {
 public:
  StereoScannerDevice(const DeviceConfig& config, StereoSettings settings, std::unique_ptr<Device> first,
                      std::unique_ptr<Device> second, Clock& clock)
      : kind_(config.kind),
        stream_(config.stream),
        s_(std::move(settings)),
        clock_(clock),
        cameras_{std::move(first), std::move(second)},
        outbox_(config.stream),
        pairs_(s_.max_skew_ns) {
    if (s_.trigger == StereoSettings::Trigger::kOnce) request_scan();
    outbox_.set_state(DeviceState::kRunning, "waits for a request");
    for (int k = 0; k < 2; ++k) pumps_[k] = std::thread([this, k] { pump(k); });
    scanner_ = std::thread([this] { scan_until_stopped(); });
  }

  ~StereoScannerDevice() override {
    stop();
    scanner_.join();
    for (std::thread& pump : pumps_) pump.join();
  }

  Result<std::optional<Sample>> next() override { return outbox_.next(); }
  DeviceHealth health() const override { return outbox_.health(); }

  void stop() override {
    outbox_.stop();
    for (const auto& camera : cameras_) camera->stop();
    std::lock_guard lock(mutex_);
    stopping_ = true;
    changed_.notify_all();
  }

  void request_scan() override {
    std::lock_guard lock(mutex_);
    requests_.push_back(clock_.now());
    changed_.notify_all();
  }

  DeviceDescription description() const override {
    DeviceDescription d;
    d.kind = kind_;
    d.stream = stream_;
    d.settings = {fmt::format("rig: {} ({}, {})", s_.rig.string(), s_.cameras[0].name, s_.cameras[1].name),
                  fmt::format("depth: {} to {} mm", s_.options.near_mm, s_.options.far_mm),
                  fmt::format("max_skew_ms: {}", static_cast<double>(s_.max_skew_ns) * 1e-6)};
    for (const auto& camera : cameras_) {
      const DeviceDescription inner = camera->description();
      for (const std::string& line : inner.settings) d.settings.push_back(inner.stream + ": " + line);
      for (const std::string& line : inner.warnings) d.warnings.push_back(inner.stream + ": " + line);
    }
    return d;
  }

 private:
  // A thread for each camera.
  void pump(int k) {
    int to_skip = s_.warm_up_frames;
    for (;;) {
      if (!wait_for_demand(k)) return;
      auto sample = cameras_[k]->next();
      if (!sample) outbox_.fail(sample.error());
      if (!sample || !*sample) {
        std::lock_guard lock(mutex_);
        ended_[k] = true;
        changed_.notify_all();
        return;
      }
      if (auto* event = std::get_if<EventSample>(&**sample)) note(*event);
      auto* frame = std::get_if<FrameSample>(&**sample);
      if (!frame || to_skip-- > 0) continue;
      std::lock_guard lock(mutex_);
      to_skip = 0;
      ++frames_[k];
      pairs_.add(k, std::move(*frame));
      changed_.notify_all();
    }
  }

  /// A live camera is always read, so that its frames are fresh; a recording only as far as it is asked for.
  bool wait_for_demand(int k) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return stopping_ || s_.live || (!requests_.empty() && pairs_.size(k) < 8); });
    return !stopping_;
  }

  void note(const EventSample& event) {
    if (event.kind != "device") return;
    outbox_.tell(event.header.capture, "device", event.pressed, event.header.stream + ": " + event.text);
    outbox_.set_state(event.pressed ? DeviceState::kRunning : DeviceState::kRecovering,
                      event.header.stream + ": " + event.text);
  }

  // The scanner's thread.
  void scan_until_stopped() {
    while (wait_for_request()) {
      const auto pair = wait_for_pair();
      if (outbox_.stopping()) break;
      pair ? scan(*pair) : outbox_.reject(clock_.now(), why_no_pair_);
      {
        std::lock_guard lock(mutex_);
        requests_.erase(requests_.begin());
      }
      if (s_.trigger == StereoSettings::Trigger::kOnce) break;
    }
    outbox_.end();
    for (const auto& camera : cameras_) camera->stop();
    std::lock_guard lock(mutex_);
    stopping_ = true;
    changed_.notify_all();
  }

  bool both_ended() const { return ended_[0] && ended_[1]; }

  bool wait_for_request() {
    std::unique_lock lock(mutex_);
    const auto due = [&] { return stopping_ || !requests_.empty() || (both_ended() && nothing_to_pair()); };
    if (s_.trigger == StereoSettings::Trigger::kInterval) {
      if (!changed_.wait_for(lock, milliseconds(std::lround(1000 * s_.interval_s)), due) || requests_.empty())
        if (!stopping_ && !(both_ended() && nothing_to_pair())) requests_.push_back(clock_.now());
    } else {
      changed_.wait(lock, due);
    }
    changed_.notify_all();  // recordings are read on from here
    return !stopping_ && !requests_.empty();
  }

  bool nothing_to_pair() const { return pairs_.size(0) == 0 || pairs_.size(1) == 0; }

  std::optional<std::pair<FrameSample, FrameSample>> wait_for_pair() {
    std::unique_lock lock(mutex_);
    const std::uint64_t before[2] = {frames_[0], frames_[1]};
    const auto since = s_.live ? std::optional<HostTime>(requests_.front()) : std::nullopt;
    std::optional<std::pair<FrameSample, FrameSample>> pair;
    const bool in_time = changed_.wait_for(lock, milliseconds(std::lround(1000 * s_.timeout_s)), [&] {
      if (!pair) pair = pairs_.take(since);
      return pair || stopping_ || both_ended();
    });
    if (!pair)
      why_no_pair_ =
          fmt::format("no two frames within {:.1f} ms of each other {}: {} from {}, {} from {}",
                      static_cast<double>(s_.max_skew_ns) * 1e-6,
                      in_time ? "before the cameras ended" : fmt::format("in {:.1f} s", s_.timeout_s),
                      frames_[0] - before[0], s_.cameras[0].name, frames_[1] - before[1], s_.cameras[1].name);
    return pair;
  }

  void scan(const std::pair<FrameSample, FrameSample>& pair) {
    const auto& [first, second] = pair;
    const auto found = stereo_surface(first.image, second.image, s_.cameras[0], s_.cameras[1], s_.options);
    const HostTime now = clock_.now();
    if (!found) return outbox_.reject(now, found.error().line());
    for (const std::string& warning : found->report.warnings) outbox_.tell(now, "warning", true, warning);
    ScanSample sample;
    const HostTime capture{first.header.capture.ns / 2 + second.header.capture.ns / 2};
    // A recording's clock starts at 0; its scans arrive when its frames did.
    sample.header =
        outbox_.header(capture, s_.live ? now : std::max(first.header.arrival, second.header.arrival));
    sample.header.device = first.header.device;
    const std::string stem = fmt::format("{}_{:04}", stream_, sample.header.sequence + 1);
    sample.name = stem + ".ply";
    std::string ply = format_scan_ply(found->surface);
    sample.sha256 = sha256_hex(ply);
    sample.files[sample.name] = std::move(ply);
    sample.files[stem + "_first.png"] = png_of(first.image);
    sample.files[stem + "_second.png"] = png_of(second.image);
    std::vector<double> deviations = found->surface.deviation_mm;
    std::nth_element(deviations.begin(), deviations.begin() + static_cast<long>(deviations.size() / 2),
                     deviations.end());
    sample.deviation_mm = deviations[deviations.size() / 2];
    outbox_.set_state(DeviceState::kRunning,
                      fmt::format("{}: {} vertices, deviation {:.3f} mm, {:.0f} % of the picture matched",
                                  sample.name, found->surface.mesh.vertices_mm.size(), sample.deviation_mm,
                                  100 * found->report.matched_share));
    outbox_.deliver(std::move(sample));
  }

  const std::string kind_, stream_;
  const StereoSettings s_;
  Clock& clock_;
  const std::unique_ptr<Device> cameras_[2];
  ScanOutbox outbox_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  FramePairs pairs_;
  std::vector<HostTime> requests_;
  std::uint64_t frames_[2] = {0, 0};
  bool ended_[2] = {false, false}, stopping_ = false;
  std::string why_no_pair_;  ///< the scanner's thread alone
  std::thread pumps_[2], scanner_;
};

}  // namespace

Result<std::unique_ptr<Device>> open_stereo_scanner(const DeviceConfig& config, Clock& clock) {
  std::string kind;
  GNATHION_TRY(StereoSettings settings, settings_from(config, &kind));
  GNATHION_TRY(std::unique_ptr<Device> first, open_device(camera_config(config, "first", kind), clock));
  GNATHION_TRY(std::unique_ptr<Device> second, open_device(camera_config(config, "second", kind), clock));
  return std::make_unique<StereoScannerDevice>(config, std::move(settings), std::move(first),
                                               std::move(second), clock);
}

}  // namespace gnathion
