// What a UVC camera says about its depth streams, and how depth frames come out of its payloads. Pure
// decoding (USB Video Class 1.5, sections 3.9.2, 2.4.3.3; payload Uncompressed 3.1).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "core/time.h"

namespace gnathion {

/// Depth along the optical axis, row-major, in the device's units; 0: no measurement.
struct DepthImage {
  int width_px = 0, height_px = 0;
  std::vector<std::uint16_t> units;
};

/// The bytes of one Z16 frame: two bytes a pixel, little-endian. Refused (kInput): any other number of bytes
/// than width·height·2, an impossible size.
Result<DepthImage> decode_z16(std::string_view bytes, int width_px, int height_px);

/// One frame size of one Z16 format.
struct DepthMode {
  std::uint8_t format = 0, frame = 0;  ///< indices for probe and commit
  int width_px = 0, height_px = 0;
  std::uint32_t interval_100ns = 0;  ///< the default one
};
/// A VideoStreaming interface with its depth modes.
struct DepthModes {
  std::uint8_t endpoint = 0;  ///< as the input header says
  std::vector<DepthMode> modes;
};
/// From the class-specific descriptors that follow a VideoStreaming interface. Broken lengths are refused;
/// formats that are not Z16 are passed over.
Result<DepthModes> parse_depth_modes(std::string_view descriptors);

/// Stream control of probe and commit, 26 bytes (UVC 1.0) or more; what is not named is 0.
struct StreamControl {
  std::uint8_t format = 0, frame = 0;
  std::uint32_t interval_100ns = 0, frame_bytes = 0, payload_bytes = 0;
};
std::string format_stream_control(const StreamControl& control);
std::optional<StreamControl> parse_stream_control(std::string_view bytes);

/// Joins payloads to frames. A frame is given only when it is whole.
class PayloadAssembler {
 public:
  explicit PayloadAssembler(std::size_t frame_bytes) : frame_bytes_(frame_bytes) {}
  struct Outcome {
    std::optional<std::string> frame;
    std::optional<std::uint32_t> device_ticks;  ///< of the frame: PTS in the camera's clock
    std::string lost;                           ///< why a frame was given up; empty: none was
  };
  /// One payload: header and data.
  Outcome add(std::string_view payload);

 private:
  void begin(bool toggle);
  const std::size_t frame_bytes_;
  std::string bytes_;
  std::optional<bool> toggle_;
  std::optional<std::uint32_t> ticks_;
  bool broken_ = false, done_ = false;
};

}  // namespace gnathion
