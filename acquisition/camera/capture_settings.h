// What devices.toml says of a camera of kind "camera".
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "acquisition/device_config.h"

namespace gnathion {

struct CaptureSettings {
  enum class Backend {
    kV4l2,   ///< a camera of this machine
    kUrl,    ///< rtsp://, http://: FFmpeg
    kFile,   ///< a video file: FFmpeg
    kFolder  ///< images in a folder, in natural order
  } backend = Backend::kFile;
  std::string source;             ///< device path, URL, absolute path
  std::string shown;              ///< the same for messages: without a password
  std::optional<double> rate_hz;  ///< asked for (cameras), or true of the recording (files, folders)
  std::optional<double> exposure_us, gain, focus;
  std::optional<int> width_px, height_px;
  std::string pixel_format;  ///< FourCC, or empty
  std::optional<double> line_time_us;
  enum class Shutter { kUnknown, kRolling, kGlobal } shutter = Shutter::kUnknown;
  double latency_us = 0;          ///< constant part of the delay, from a temporal calibration
  bool device_clock = true;       ///< presentation times are a clock; else arrival is all there is
  std::size_t queue_frames = 32;  ///< held for a slow reader; a URL's first second must fit in too

  bool live() const { return backend == Backend::kV4l2 || backend == Backend::kUrl; }
};

/// Refuses what cannot be: unknown keys, autofocus, an exposure longer than the frame period, a folder
/// without rate, a file that is not there, a camera without permission (naming the udev rule).
Result<CaptureSettings> read_capture_settings(const DeviceConfig& config);

}  // namespace gnathion
