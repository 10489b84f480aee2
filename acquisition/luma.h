// Colour to grey.
#pragma once

#include <cstdint>

namespace gnathion {

/// Luma of ITU-R BT.601 of red, green, blue bytes, in integers, rounded; the weights sum to 2^15.
inline std::uint8_t luma_from_rgb(std::uint8_t red, std::uint8_t green, std::uint8_t blue) {
  return static_cast<std::uint8_t>((9798u * red + 19235u * green + 3735u * blue + (1u << 14)) >> 15);
}

}  // namespace gnathion
