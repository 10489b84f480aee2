// Where frames of kind "camera" come from: OpenCV's VideoCapture, or the images of a folder.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquisition/camera/capture_settings.h"
#include "core/image.h"
#include "core/time.h"

namespace gnathion {

/// One frame as the source gave it, before it has times and number.
struct ReadFrame {
  Image8 image;
  std::string bad;                   ///< why there is no image
  std::optional<DeviceTime> device;  ///< the source's own clock: presentation time, driver's stamp
  std::uint32_t skipped = 0;         ///< frames that the source says are missing before this one
};

/// One thread at a time.
class FrameReader {
 public:
  virtual ~FrameReader() = default;
  enum class Outcome {
    kFrame,
    kEnd,   ///< of a file or folder
    kLost,  ///< a live source that gives nothing any more
  };
  /// Waits for the next frame; `grabbed` is set as soon as it is there, before it is decoded.
  virtual Outcome read(Clock& clock, HostTime* grabbed, ReadFrame* frame) = 0;
  /// Frames that a file announced and did not have, once it has ended.
  virtual std::uint32_t short_of() const { return 0; }
  virtual double rate_hz() const = 0;  ///< nominal; 0: not known
  /// As the camera says it is, or as configured where it cannot be asked; 0: not known.
  double exposure_us = 0;

  std::vector<std::string> setting_lines, warning_lines;  ///< for the device's description
};

/// Opens the source and sets it, reading everything back; an error says what the source refuses.
Result<std::unique_ptr<FrameReader>> open_video(const CaptureSettings& settings, const std::string& where);
Result<std::unique_ptr<FrameReader>> open_folder(const CaptureSettings& settings, const std::string& where);

}  // namespace gnathion
