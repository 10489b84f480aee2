// Face scanners as devices: a watched folder, a stereo pair of cameras, a USB depth camera. They deliver
// ScanSample.
#pragma once

#include <memory>

#include "acquisition/device.h"

namespace gnathion {

/// Kind "scan_folder" (docs/devices/scan-folder.md).
Result<std::unique_ptr<Device>> open_scan_folder(const DeviceConfig& config, Clock& clock);
/// Kind "stereo_scanner" (docs/devices/stereo-scanner.md); its device is a ScanOnRequest too.
Result<std::unique_ptr<Device>> open_stereo_scanner(const DeviceConfig& config, Clock& clock);
/// Kind "depth_camera" (docs/devices/depth-camera.md); its device is a ScanOnRequest too.
Result<std::unique_ptr<Device>> open_depth_camera(const DeviceConfig& config, Clock& clock);

/// A device that scans when it is told to: dynamic_cast a Device to it.
class ScanOnRequest {
 public:
  virtual ~ScanOnRequest() = default;
  /// Asks for one scan of what is seen from now on. Any thread; returns at once. Requests are counted: each
  /// one is answered by a ScanSample or by a rejected LedgerSample that says why there is none, unless the
  /// device is stopped meanwhile.
  virtual void request_scan() = 0;
};

/// A device that remembers across sessions which scans it delivered: dynamic_cast a Device to it.
class RemembersScans {
 public:
  virtual ~RemembersScans() = default;
  /// The recording failed (full disk): what was delivered last may not be in it and is to be offered again.
  /// After the device was stopped, before it is destroyed. Any thread.
  virtual void recording_failed() = 0;
};

}  // namespace gnathion
