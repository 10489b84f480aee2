#include <dlfcn.h>
#include <fmt/format.h>

#include <cmath>
#include <cstdarg>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "acquisition/camera/frame_reader.h"
#include "acquisition/camera/mono.h"
#include "acquisition/camera/pts_gap.h"

namespace gnathion {
namespace {

using Backend = CaptureSettings::Backend;
constexpr const char* kWhat = "cannot open camera";
constexpr int kOpenTimeoutMs = 5000, kReadTimeoutMs = 3000;
/// V4L2_CID_EXPOSURE_AUTO: 1 is manual, 3 aperture priority (linux/v4l2-controls.h).
constexpr double kManualExposure = 1;
/// V4L2_CID_EXPOSURE_ABSOLUTE counts in 100 µs.
constexpr double kExposureUnitUs = 100;

std::string fourcc_text(double code) {
  const auto c = static_cast<std::uint32_t>(std::max(0.0, code));
  std::string text;
  for (int shift = 0; shift < 32; shift += 8) {
    const char letter = static_cast<char>((c >> shift) & 0xff);
    text += letter >= ' ' && letter <= '~' ? letter : '?';
  }
  return text;
}

/// What goes wrong comes back as a value and is told in one line; the libraries are not to print lines of
/// their own. OpenCV sets FFmpeg's log level anew whenever it opens something, but leaves its callback alone.
/// libavutil is OpenCV's dependency and not ours: the symbol is there or it is not.
void be_quiet() {
  static const bool quiet = [] {
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    using Callback = void (*)(void*, int, const char*, va_list);
    if (void* symbol = ::dlsym(RTLD_DEFAULT, "av_log_set_callback"))
      reinterpret_cast<void (*)(Callback)>(symbol)([](void*, int, const char*, va_list) {});
    return true;
  }();
  static_cast<void>(quiet);
}

class VideoReader : public FrameReader {
 public:
  VideoReader(CaptureSettings settings, std::string where)
      : s_(std::move(settings)), where_(std::move(where)) {}

  Status open() {
    be_quiet();
    try {
      const bool v4l2 = s_.backend == Backend::kV4l2;
      const bool opened = v4l2 ? capture_.open(s_.source, cv::CAP_V4L2)
                               : capture_.open(s_.source, cv::CAP_FFMPEG,
                                               {cv::CAP_PROP_OPEN_TIMEOUT_MSEC, kOpenTimeoutMs,
                                                cv::CAP_PROP_READ_TIMEOUT_MSEC, kReadTimeoutMs});
      if (!opened) return refuse(why_not_opened());
      if (v4l2) GNATHION_CHECK_OK(set_camera());
      if (!v4l2) refuse_nothing_but_report();
      container_rate_hz_ = capture_.get(cv::CAP_PROP_FPS);
      if (!(container_rate_hz_ > 0.1 && container_rate_hz_ < 1001)) container_rate_hz_ = 0;
      if (s_.backend == Backend::kFile) announced_ = capture_.get(cv::CAP_PROP_FRAME_COUNT);
      if (s_.backend == Backend::kFile && container_rate_hz_ == 0 && !s_.rate_hz)
        return refuse("the file does not tell its frame rate; set rate_hz");
      if (s_.backend == Backend::kUrl && s_.rate_hz) container_rate_hz_ = *s_.rate_hz;
      // Automatic exposure lowers the rate in the dark; what is late then is not missing.
      const bool steady = !v4l2 || capture_.get(cv::CAP_PROP_AUTO_EXPOSURE) == kManualExposure;
      if (!steady) setting_lines.push_back("missing frames: not counted, exposure is not manual");
      gap_ = PtsGap(steady && (s_.backend == Backend::kFile || s_.device_clock) ? container_rate_hz_ : 0);
      return {};
    } catch (const cv::Exception& e) {
      return refuse(e.err);
    }
  }

  double rate_hz() const override {
    return s_.backend == Backend::kFile && s_.rate_hz ? *s_.rate_hz : container_rate_hz_;
  }

  std::uint32_t short_of() const override {
    // Containers round: two frames or 2 % less are not worth a line.
    if (announced_ < 1 || frames_ + 2 >= 0.98 * announced_) return 0;
    return static_cast<std::uint32_t>(announced_ - frames_);
  }

  Outcome read(Clock& clock, HostTime* grabbed, ReadFrame* frame) override {
    try {
      if (!capture_.grab()) return s_.live() ? Outcome::kLost : Outcome::kEnd;
      *grabbed = clock.now();
      const double pts_ms = capture_.get(cv::CAP_PROP_POS_MSEC);
      ++frames_;
      take_time(pts_ms, frame);
      if (!capture_.retrieve(image_) || image_.empty())
        frame->bad = "cannot be decoded";
      else
        frame->bad = to_mono8(image_, &frame->image);
    } catch (const cv::Exception& e) {
      frame->bad = "cannot be decoded: " + e.err;
    }
    return Outcome::kFrame;
  }

 private:
  tl::unexpected<Error> refuse(const std::string& why) const { return bad_input(kWhat, where_, why); }

  std::string why_not_opened() const {
    switch (s_.backend) {
      case Backend::kV4l2:
        return s_.shown + " is not a camera, or another program has it open";
      case Backend::kUrl:
        return fmt::format("no video from {} within {} s", s_.shown, kOpenTimeoutMs / 1000);
      default:
        return s_.shown + " is not a video that FFmpeg can read";
    }
  }

  /// Presentation time to device time. A file whose true rate is given is a slowed or quickened one.
  void take_time(double pts_ms, ReadFrame* frame) {
    if (s_.backend == Backend::kUrl && !s_.device_clock) return;
    const double pts_s = std::isfinite(pts_ms) ? pts_ms * 1e-3 : 0;
    frame->skipped = gap_.take(pts_s);
    double device_s = pts_s;
    if (s_.backend == Backend::kFile && s_.rate_hz)
      device_s =
          container_rate_hz_ > 0 ? pts_s * container_rate_hz_ / *s_.rate_hz : (frames_ - 1) / *s_.rate_hz;
    frame->device = DeviceTime{std::llround(device_s * 1e9)};
  }

  void refuse_nothing_but_report() {
    const bool url = s_.backend == Backend::kUrl;
    exposure_us = url ? s_.exposure_us.value_or(0) : 0;
    if (url)
      for (const auto& [name, asked] : {std::pair{"exposure_us", s_.exposure_us}, std::pair{"gain", s_.gain},
                                        std::pair{"focus", s_.focus}})
        if (asked)
          setting_lines.push_back(fmt::format("{}: {} is taken as set; a URL cannot be asked", name, *asked));
    setting_lines.push_back(fmt::format("size_px: {}x{}", capture_.get(cv::CAP_PROP_FRAME_WIDTH),
                                        capture_.get(cv::CAP_PROP_FRAME_HEIGHT)));
    setting_lines.push_back("pixel_format: " + fourcc_text(capture_.get(cv::CAP_PROP_FOURCC)));
  }

  /// Order matters: the format and size restrict the rates, manual exposure the exposures.
  Status set_camera() {
    if (!s_.pixel_format.empty()) {
      const std::string& f = s_.pixel_format;
      const double code = cv::VideoWriter::fourcc(f[0], f[1], f[2], f[3]);
      capture_.set(cv::CAP_PROP_FOURCC, code);
      const std::string got = fourcc_text(capture_.get(cv::CAP_PROP_FOURCC));
      report("pixel_format", got, f, got != f);
    }
    set_and_report("width_px", cv::CAP_PROP_FRAME_WIDTH, s_.width_px, 1, 0);
    set_and_report("height_px", cv::CAP_PROP_FRAME_HEIGHT, s_.height_px, 1, 0);
    GNATHION_CHECK_OK(set_rate());
    GNATHION_CHECK_OK(turn_autofocus_off());
    set_and_report("focus", cv::CAP_PROP_FOCUS, s_.focus, 1, 0);
    if (s_.exposure_us) {
      capture_.set(cv::CAP_PROP_AUTO_EXPOSURE, kManualExposure);
      if (capture_.get(cv::CAP_PROP_AUTO_EXPOSURE) != kManualExposure)
        warning_lines.push_back("exposure_us: the camera does not leave automatic exposure");
      set_and_report("exposure_us", cv::CAP_PROP_EXPOSURE, s_.exposure_us, kExposureUnitUs, 0);
      exposure_us = std::max(0.0, capture_.get(cv::CAP_PROP_EXPOSURE)) * kExposureUnitUs;
    }
    set_and_report("gain", cv::CAP_PROP_GAIN, s_.gain, 1, 0);
    return {};
  }

  Status set_rate() {
    if (!s_.rate_hz) return {};
    capture_.set(cv::CAP_PROP_FPS, *s_.rate_hz);
    const double got = capture_.get(cv::CAP_PROP_FPS);
    if (!(std::abs(got - *s_.rate_hz) <= 0.1 * *s_.rate_hz))
      return refuse(fmt::format("rate_hz {} is impossible at {}x{} {}: the camera gives {}", *s_.rate_hz,
                                capture_.get(cv::CAP_PROP_FRAME_WIDTH),
                                capture_.get(cv::CAP_PROP_FRAME_HEIGHT),
                                fourcc_text(capture_.get(cv::CAP_PROP_FOURCC)), got));
    report("rate_hz", fmt::format("{}", got), fmt::format("{}", *s_.rate_hz), got != *s_.rate_hz);
    return {};
  }

  /// A lens that moves by itself makes the calibration worthless.
  Status turn_autofocus_off() {
    if (capture_.get(cv::CAP_PROP_AUTOFOCUS) < 0) {
      setting_lines.push_back("autofocus: the camera has none");
      return {};
    }
    capture_.set(cv::CAP_PROP_AUTOFOCUS, 0);
    if (capture_.get(cv::CAP_PROP_AUTOFOCUS) != 0)
      return refuse("autofocus cannot be turned off; the camera's calibration would not hold");
    setting_lines.push_back("autofocus: off");
    return {};
  }

  template <class T>
  void set_and_report(const char* name, int property, const std::optional<T>& asked, double unit,
                      double slack) {
    if (!asked) return;
    const double wanted = static_cast<double>(*asked);
    capture_.set(property, wanted / unit);
    const double raw = capture_.get(property);
    if (raw < 0)
      warning_lines.push_back(fmt::format("{}: the camera has no such control (asked {})", name, wanted));
    else
      report(name, fmt::format("{}", raw * unit), fmt::format("{}", wanted),
             std::abs(raw * unit - wanted) > slack);
  }

  void report(const std::string& name, const std::string& got, const std::string& asked, bool differs) {
    setting_lines.push_back(differs ? fmt::format("{}: {} (asked {})", name, got, asked)
                                    : fmt::format("{}: {}", name, got));
    if (differs) warning_lines.push_back(setting_lines.back());
  }

  CaptureSettings s_;
  std::string where_;
  cv::VideoCapture capture_;
  cv::Mat image_;
  PtsGap gap_{0};
  double container_rate_hz_ = 0, announced_ = 0, frames_ = 0;
};

}  // namespace

Result<std::unique_ptr<FrameReader>> open_video(const CaptureSettings& settings, const std::string& where) {
  auto reader = std::make_unique<VideoReader>(settings, where);
  GNATHION_CHECK_OK(reader->open());
  return reader;
}

}  // namespace gnathion
