// Kind "camera": any OpenCV VideoCapture source, and folders of images.
#pragma once

#include <memory>

#include "acquisition/device.h"

namespace gnathion {

/// `source` decides: a number or /dev/video… (V4L2), rtsp:// or http:// (FFmpeg), a folder of images or a
/// video file. Live sources drop what is not taken in time, with a ledger line; files never drop, end at
/// their end, and give the same capture times every time (0 + presentation time).
/// docs/devices/opencv-camera.md.
Result<std::unique_ptr<Device>> open_capture_device(const DeviceConfig& config, Clock& clock);

}  // namespace gnathion
