// 8-bit grey images.
#pragma once

#include <cstdint>
#include <vector>

namespace gnathion {

/// Row-major, no padding; pixel (0, 0) is the upper left one and its centre has the coordinates
/// (0, 0) px, as in OpenCV.
struct Image8 {
  int width_px = 0;
  int height_px = 0;
  std::vector<std::uint8_t> pixels;

  Image8() = default;
  Image8(int width, int height, std::uint8_t value = 0)
      : width_px(width),
        height_px(height),
        pixels(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), value) {}
  std::uint8_t& at(int x, int y) {
    return pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_px) +
                  static_cast<std::size_t>(x)];
  }
  std::uint8_t at(int x, int y) const { return const_cast<Image8*>(this)->at(x, y); }
};

}  // namespace gnathion
