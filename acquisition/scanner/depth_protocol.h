// Z16: depth frames of USB cameras, two bytes a pixel, little-endian (UVC format GUID "Z16 ").
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace gnathion {

/// Depth along the optical axis, row-major, in the device's units; 0: no measurement.
struct DepthImage {
  int width_px = 0, height_px = 0;
  std::vector<std::uint16_t> units;
};

/// The bytes of one frame. Refused (kInput): any other number of bytes than width·height·2.
Result<DepthImage> decode_z16(std::string_view bytes, int width_px, int height_px);

}  // namespace gnathion
