#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "acquisition/scanner/depth_fusion.h"
#include "acquisition/scanner/scan_devices.h"
#include "acquisition/scanner/scan_outbox.h"
#include "acquisition/scanner/surface_deviation.h"
#include "acquisition/scanner/uvc_depth_stream.h"
#include "core/file.h"

namespace gnathion {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

struct DepthSettings {
  UvcDepthChoice camera;
  CameraModel intrinsics;
  DepthFusionOptions fusion;
  int frames = 30, warm_up_frames = 5;
  double timeout_s = 10;
  bool once = false;
};

std::uint16_t id_from(SettingsReader& read, const char* key) {
  const std::string text = read.text(key).value_or("");
  std::size_t used = 0;
  unsigned long value = 0;
  try {
    value = std::stoul(text, &used, 16);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used == 0 || used != text.size() || value == 0 || value > 0xffff)
    read.refuse(key, "must be a USB id of four hexadecimal digits, as text: lsusb shows it");
  return static_cast<std::uint16_t>(value);
}

Result<DepthSettings> settings_from(const DeviceConfig& config) {
  SettingsReader read(config);
  DepthSettings s;
  s.camera.vendor = id_from(read, "vendor");
  s.camera.product = id_from(read, "product");
  s.camera.serial = read.text("serial").value_or("");
  const auto intrinsics = read.path("intrinsics");
  if (!intrinsics) read.refuse("intrinsics", "is missing: a TOML file with one [[camera]]");
  s.frames = static_cast<int>(read.number_in("frames", 3, 1000, s.frames));
  s.warm_up_frames = static_cast<int>(read.number_in("warm_up_frames", 0, 1000, s.warm_up_frames));
  s.timeout_s = read.number_in("timeout_s", 0.1, 600, s.timeout_s);
  s.fusion.unit_mm = read.number_in("unit_mm", 0.001, 100, s.fusion.unit_mm);
  s.fusion.near_mm = read.number_in("near_mm", 10, 10000, s.fusion.near_mm);
  s.fusion.far_mm = read.number_in("far_mm", 10, 10000, s.fusion.far_mm);
  s.fusion.flying_mm = read.number_in("flying_mm", 0.1, 1000, s.fusion.flying_mm);
  if (s.fusion.far_mm <= s.fusion.near_mm) read.refuse("far_mm", "must be larger than near_mm");
  s.once = read.choice("trigger", {"once", "request"}, "request") == "once";
  GNATHION_CHECK_OK(read.finish());
  GNATHION_TRY(const std::vector<RigCamera> cameras, read_rig_cameras(*intrinsics));
  if (cameras.size() != 1)
    return bad_input("cannot open device", config.where,
                     fmt::format("{} has {} cameras; one is meant", intrinsics->string(), cameras.size()));
  s.intrinsics = cameras.front().model;
  s.camera.width_px = s.intrinsics.width_px;
  s.camera.height_px = s.intrinsics.height_px;
  return s;
}

/// Frames of one uninterrupted stream.
struct Burst {
  std::vector<DepthImage> frames;
  HostTime first, last;           ///< when the first and the last frame that is kept came
  std::vector<std::string> lost;  ///< why frames between them are missing
};

class DepthCameraDevice : public Device, public ScanOnRequest {
 public:
  DepthCameraDevice(const DeviceConfig& config, DepthSettings settings, Clock& clock)
      : kind_(config.kind),
        stream_(config.stream),
        where_(config.where),
        s_(std::move(settings)),
        clock_(clock),
        outbox_(config.stream) {
    description_.kind = kind_;
    description_.stream = stream_;
    description_.settings = {fmt::format("camera: {:04x}:{:04x}", s_.camera.vendor, s_.camera.product),
                             fmt::format("depth: {}x{} px, {} mm a count", s_.camera.width_px,
                                         s_.camera.height_px, s_.fusion.unit_mm),
                             fmt::format("frames: {} after {}", s_.frames, s_.warm_up_frames)};
    outbox_.set_state(DeviceState::kRunning, "waits for a request");
    if (s_.once) request_scan();
    scanner_ = std::thread([this] { scan_until_stopped(); });
  }

  ~DepthCameraDevice() override {
    stop();
    scanner_.join();
  }

  Result<std::optional<Sample>> next() override { return outbox_.next(); }
  DeviceHealth health() const override { return outbox_.health(); }
  void stop() override {
    outbox_.stop();
    const std::lock_guard lock(mutex_);
    changed_.notify_all();
  }
  void request_scan() override {
    const std::lock_guard lock(mutex_);
    ++requests_;
    changed_.notify_all();
  }
  DeviceDescription description() const override {
    const std::lock_guard lock(mutex_);
    return description_;
  }

 private:
  void scan_until_stopped() {
    while (wait_for_request()) {
      const auto frames = burst();
      if (outbox_.stopping()) break;
      if (frames)
        deliver(*frames);
      else
        outbox_.reject(clock_.now(), frames.error().line());
      if (s_.once) break;
    }
    outbox_.end();
  }

  bool wait_for_request() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return outbox_.stopping() || requests_ > 0; });
    if (requests_ > 0) --requests_;
    return !outbox_.stopping();
  }

  /// The stream runs only for a scan: the camera's projector is off between scans. While it cannot be opened
  /// it is tried again until the time is over. A camera that went away begins anew, warm-up and all: it may
  /// have been moved.
  Result<Burst> burst() {
    const auto end = steady_clock::now() + milliseconds(static_cast<long>(1000 * s_.timeout_s));
    std::unique_ptr<UvcDepthStream> stream;
    Burst burst;
    int to_skip = s_.warm_up_frames;
    Error last{ErrorCode::kInput, "cannot scan", where_, "no frame came"};
    while (static_cast<int>(burst.frames.size()) < s_.frames && !outbox_.stopping()) {
      if (steady_clock::now() > end) {
        last.why +=
            fmt::format(" ({} of {} frames in {:.1f} s{}{})", burst.frames.size(), s_.frames, s_.timeout_s,
                        burst.lost.empty() ? "" : "; lost: ", burst.lost.empty() ? "" : burst.lost.back());
        return tl::unexpected<Error>(last);
      }
      if (!stream) {
        auto opened = UvcDepthStream::open(s_.camera, where_);
        if (!opened) {
          away(last = opened.error());
          std::this_thread::sleep_for(milliseconds(50));
          continue;
        }
        stream = std::move(*opened);
        here(*stream);
      }
      auto event = stream->next(100);
      if (!event) {
        away(last = event.error());
        stream.reset();
        burst = {};
        to_skip = s_.warm_up_frames;
        continue;
      }
      if (!event->lost.empty()) burst.lost.push_back(event->lost);
      if (!event->frame || to_skip-- > 0) continue;
      burst.last = clock_.now();
      if (burst.frames.empty()) burst.first = burst.last;
      burst.frames.push_back(std::move(*event->frame));
    }
    return burst;
  }

  void away(const Error& error) {
    if (is_away_) return;
    is_away_ = true;
    outbox_.tell(clock_.now(), "device", false, error.line());
    outbox_.set_state(DeviceState::kRecovering, error.line());
  }

  void here(const UvcDepthStream& stream) {
    {
      const std::lock_guard lock(mutex_);
      description_.model = stream.model();
      description_.serial = stream.serial();
    }
    if (is_away_) outbox_.tell(clock_.now(), "device", true, "back");
    is_away_ = false;
    outbox_.set_state(DeviceState::kRunning, "scanning");
  }

  void deliver(const Burst& burst) {
    const HostTime now = clock_.now();
    const auto fused = fuse_depth(burst.frames, s_.intrinsics, s_.fusion);
    if (!fused) return outbox_.reject(now, fused.error().line());
    const ScanSurface surface = surface_from_grid(fused->grid, {}, {});
    if (surface.mesh.empty()) return outbox_.reject(now, "what was measured holds together nowhere");
    if (!burst.lost.empty())
      outbox_.tell(now, "warning", true,
                   fmt::format("{} frame(s) of the burst were lost; the last: {}", burst.lost.size(),
                               burst.lost.back()));
    ScanSample sample;
    sample.header = outbox_.header(HostTime{burst.first.ns + (burst.last.ns - burst.first.ns) / 2}, now);
    sample.name = fmt::format("{}_{:04}.ply", stream_, sample.header.sequence + 1);
    std::string ply = format_scan_ply(surface);
    sample.sha256 = sha256_hex(ply);
    sample.files[sample.name] = std::move(ply);
    std::vector<double> deviations = surface.deviation_mm;
    const auto middle = deviations.begin() + static_cast<long>(deviations.size() / 2);
    std::nth_element(deviations.begin(), middle, deviations.end());
    sample.deviation_mm = *middle;
    // What every frame has alike does not show between frames, but in the surface.
    if (const auto own = measure_surface_deviation(surface.mesh); own)
      sample.deviation_mm = std::max(sample.deviation_mm, own->sigma_mm);
    outbox_.set_state(
        DeviceState::kRunning,
        fmt::format("{}: {} vertices of {} frames, deviation {:.3f} mm, a single frame's {:.3f} mm",
                    sample.name, surface.mesh.vertices_mm.size(), fused->frames, sample.deviation_mm,
                    fused->frame_sigma_mm));
    outbox_.deliver(std::move(sample));
  }

  const std::string kind_, stream_, where_;
  const DepthSettings s_;
  Clock& clock_;
  ScanOutbox outbox_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  int requests_ = 0;
  bool is_away_ = false;  ///< the scanner's thread alone
  DeviceDescription description_;
  std::thread scanner_;
};

}  // namespace

Result<std::unique_ptr<Device>> open_depth_camera(const DeviceConfig& config, Clock& clock) {
  GNATHION_TRY(DepthSettings settings, settings_from(config));
  return std::make_unique<DepthCameraDevice>(config, std::move(settings), clock);
}

}  // namespace gnathion
