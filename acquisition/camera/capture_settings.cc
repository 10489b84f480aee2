#include "acquisition/camera/capture_settings.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using Backend = CaptureSettings::Backend;
constexpr const char* kWhat = "cannot open camera";

bool is_number(const std::string& text) {
  return !text.empty() &&
         std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
}

/// "rtsp://user:secret@host/x" → "rtsp://user:***@host/x".
std::string without_password(const std::string& url) {
  const std::size_t start = url.find("://");
  if (start == std::string::npos) return url;
  const std::size_t host_end = url.find('/', start + 3);
  const std::size_t at = url.rfind('@', host_end == std::string::npos ? url.size() : host_end);
  if (at == std::string::npos || at < start) return url;
  const std::size_t colon = url.find(':', start + 3);
  if (colon == std::string::npos || colon > at) return url;
  return url.substr(0, colon + 1) + "***" + url.substr(at);
}

Status check_v4l2(const CaptureSettings& s, const std::string& where) {
  if (::access(s.source.c_str(), R_OK | W_OK) == 0) return {};
  if (errno == EACCES || errno == EPERM)
    return bad_input(kWhat, where,
                     fmt::format("no permission for {}: install packaging/udev/71-gnathion-cameras.rules, or "
                                 "join the group 'video'",
                                 s.shown));
  return bad_input(
      kWhat, where,
      fmt::format("{}: {}; plugged-in cameras are in /dev/v4l/by-id", s.shown, std::strerror(errno)));
}

Status check_file(const CaptureSettings& s, const std::string& where) {
  if (::access(s.source.c_str(), R_OK) == 0) return {};
  return bad_input(kWhat, where, fmt::format("{}: {}", s.shown, std::strerror(errno)));
}

/// Which backend a source means, with relative paths from the configuration's folder.
void place_source(const std::string& text, const fs::path& folder, CaptureSettings* s) {
  s->source = s->shown = text;
  if (is_number(text)) {
    s->backend = Backend::kV4l2;
    s->source = s->shown = "/dev/video" + text;
  } else if (text.rfind("/dev/", 0) == 0) {
    s->backend = Backend::kV4l2;
  } else if (text.find("://") != std::string::npos) {
    s->backend = Backend::kUrl;
    s->shown = without_password(text);
  } else {
    const fs::path path = fs::path(text).is_absolute() ? fs::path(text) : folder / text;
    std::error_code ignored;
    s->backend = fs::is_directory(path, ignored) ? Backend::kFolder : Backend::kFile;
    s->source = s->shown = path.string();
  }
}

std::string source_text(const DeviceConfig& config, SettingsReader* reader) {
  const auto found = config.settings.find("source");
  if (found != config.settings.end() && std::holds_alternative<std::int64_t>(found->second)) {
    const std::int64_t index = *reader->integer("source");
    if (index < 0) reader->refuse("source", "is negative; cameras count from 0");
    return std::to_string(index);
  }
  const std::string text = reader->text("source").value_or("");
  if (text.empty())
    reader->refuse("source", "is not given: a number, a device, a URL, a video file or a folder of images");
  return text;
}

void refuse_what_files_have_not(const DeviceConfig& config, SettingsReader* reader) {
  for (const char* key : {"gain", "focus", "pixel_format", "width_px", "height_px", "device_clock"})
    if (config.settings.count(key)) reader->refuse(key, "cannot be set: the source is a recording");
}

std::optional<double> positive(SettingsReader* reader, const char* key, double high) {
  const std::optional<double> value = reader->number(key);
  if (value && !(*value > 0 && *value <= high))
    reader->refuse(key, fmt::format("is {}; it must be above 0 and at most {}", *value, high));
  return value;
}

}  // namespace

Result<CaptureSettings> read_capture_settings(const DeviceConfig& config) {
  SettingsReader reader(config);
  CaptureSettings s;
  place_source(source_text(config, &reader), config.folder, &s);
  s.rate_hz = positive(&reader, "rate_hz", 1000);
  s.exposure_us = positive(&reader, "exposure_us", 1e6);
  s.gain = reader.number("gain");
  s.focus = reader.number("focus");
  for (const auto& [key, value] : {std::pair{"width_px", &s.width_px}, std::pair{"height_px", &s.height_px}})
    if (const auto size = positive(&reader, key, 16384)) *value = static_cast<int>(*size);
  s.pixel_format = reader.text("pixel_format").value_or("");
  if (!s.pixel_format.empty() && s.pixel_format.size() != 4)
    reader.refuse("pixel_format", "must be a FourCC of four letters: \"MJPG\", \"YUYV\", \"GREY\"");
  if (reader.flag("autofocus").value_or(false))
    reader.refuse("autofocus", "is refused: the camera's calibration holds for one focus only");
  const std::string shutter = reader.choice("shutter", {"rolling", "global"}, "");
  if (shutter == "rolling") s.shutter = CaptureSettings::Shutter::kRolling;
  if (shutter == "global") s.shutter = CaptureSettings::Shutter::kGlobal;
  s.line_time_us = positive(&reader, "line_time_us", 1000);
  if (s.line_time_us && s.shutter != CaptureSettings::Shutter::kRolling)
    reader.refuse("line_time_us", "is of a rolling shutter: set shutter = \"rolling\"");
  s.latency_us = reader.number_in("latency_us", -1e6, 1e6, 0);
  // MJPEG over HTTP carries no times: FFmpeg makes them up from an assumed rate.
  const bool has_clock = s.source.rfind("http", 0) != 0;
  s.device_clock = reader.choice("device_clock", {"pts", "arrival"}, has_clock ? "pts" : "arrival") == "pts";
  s.queue_frames = static_cast<std::size_t>(
      reader.number_in("queue_frames", 2, 1000, s.backend == Backend::kUrl ? 128 : 32));
  if (!s.live()) refuse_what_files_have_not(config, &reader);
  if (s.backend == Backend::kFolder && !s.rate_hz)
    reader.refuse("rate_hz", "is not given: a folder of images does not tell its rate");
  if (s.rate_hz && s.exposure_us && *s.exposure_us > 1e6 / *s.rate_hz)
    reader.refuse("rate_hz", fmt::format("is {}, but an exposure of {} us allows {:.1f} at most", *s.rate_hz,
                                         *s.exposure_us, 1e6 / *s.exposure_us));
  GNATHION_CHECK_OK(reader.finish());
  if (s.backend == Backend::kV4l2) GNATHION_CHECK_OK(check_v4l2(s, config.where));
  if (!s.live()) GNATHION_CHECK_OK(check_file(s, config.where));
  return s;
}

}  // namespace gnathion
