// A picture in memory, what can be painted on it, and its PNG.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/result.h"
#include "rendering/drawing.h"

namespace gnathion {

/// Rows from the top, 0x00RRGGBB.
struct Pixels {
  int width_px = 0, height_px = 0;
  std::vector<std::uint32_t> rgb;
  Pixels(int width, int height)
      : width_px(width),
        height_px(height),
        rgb(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 0xFFFFFFu) {}
};

/// Over what is there; `scale`: pixels per point.
Status paint(const Drawing& drawing, double scale, Pixels& onto);
/// Fast rather than small: a picture of a design takes 20 ms.
Result<std::string> png_bytes(const Pixels& pixels);

}  // namespace gnathion
