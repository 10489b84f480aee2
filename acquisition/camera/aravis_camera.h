// One GenICam camera through Aravis: found, set, streaming.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquisition/device_config.h"
#include "core/image.h"
#include "core/time.h"

namespace gnathion {

struct AravisSettings {
  std::string serial, id, ip;  ///< which camera; several must all hold
  std::optional<double> rate_hz, exposure_us, gain;
  std::optional<int> width_px, height_px, x_px, y_px;
  std::string trigger = "free";  ///< or the camera's trigger source, as "Line0"
  std::optional<int> packet_size_bytes;
  double latency_us = 0;  ///< constant part of the delay, from a temporal calibration
  int buffers = 16;       ///< frames that Aravis may hold
  std::size_t queue_frames = 32;
};
Result<AravisSettings> read_aravis_settings(const DeviceConfig& config);

/// One thread at a time; control may be lost at any time, which next() tells.
class AravisCamera {
 public:
  /// Finds the camera, sets it, reads everything back and starts it. Errors name what the camera allows.
  static Result<std::unique_ptr<AravisCamera>> open(const AravisSettings& settings, const std::string& where);
  ~AravisCamera();

  struct Buffer {
    std::uint64_t frame_id = 0;
    std::optional<DeviceTime> device;
    Image8 image;
    std::string bad;  ///< why there is no image: "packets missing"
  };
  /// Waits for a frame for at most `timeout_ms`; `arrival` is set when there is one.
  std::optional<Buffer> next(int timeout_ms, Clock& clock, HostTime* arrival);
  bool control_lost() const;
  /// Asks the camera something: whether it is still there.
  bool answers();

  std::string vendor, model, serial;
  std::vector<std::string> setting_lines, warning_lines;
  double rate_hz = 0;  ///< read back; 0 with a trigger
  double exposure_us = 0;

 private:
  AravisCamera();
  struct Handles;
  Status find(const AravisSettings& s, const std::string& where);
  Status set(const AravisSettings& s, const std::string& where);
  Status set_region(const AravisSettings& s, const std::string& where);
  void turn_automatics_off();
  void shorten_exposure(const AravisSettings& s);
  Status set_exposure(const AravisSettings& s, const std::string& where);
  Status set_gain(const AravisSettings& s, const std::string& where);
  Status set_trigger(const AravisSettings& s, const std::string& where);
  Status start(const AravisSettings& s, const std::string& where);
  void report(const std::string& name, double got, const std::optional<double>& asked);
  std::unique_ptr<Handles> handles_;
};

}  // namespace gnathion
