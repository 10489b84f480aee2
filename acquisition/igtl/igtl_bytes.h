// Big-endian numbers and texts inside OpenIGTLink messages. The caller has checked that the bytes are there.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

namespace gnathion::igtl {

inline std::uint64_t big_endian(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
  return value;
}
inline std::uint16_t u16(std::string_view b, std::size_t at) {
  return static_cast<std::uint16_t>(big_endian(b, at, 2));
}
inline std::uint32_t u32(std::string_view b, std::size_t at) {
  return static_cast<std::uint32_t>(big_endian(b, at, 4));
}
inline std::uint64_t u64(std::string_view b, std::size_t at) {
  std::uint64_t value = 0;
  std::memcpy(&value, b.data() + at, sizeof value);
  return std::endian::native == std::endian::little ? __builtin_bswap64(value) : value;
}
inline double f32(std::string_view b, std::size_t at) {
  return static_cast<double>(std::bit_cast<float>(u32(b, at)));
}
inline void append_big_endian(std::string& out, std::uint64_t value, int count) {
  for (int i = count - 1; i >= 0; --i) out += static_cast<char>(value >> (8 * i) & 0xff);
}
/// A field of fixed length up to its first NUL, unprintable bytes as '?': what a recording and a message to
/// the user can hold.
std::string text_field(std::string_view b, std::size_t at, std::size_t count);

}  // namespace gnathion::igtl
