// A UVC depth camera's bytes: descriptors and payloads, written from the USB Video Class specification.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace gnathion {

inline std::string little_endian(std::uint32_t value, int bytes) {
  std::string out;
  for (int k = 0; k < bytes; ++k) out += static_cast<char>((value >> (8 * k)) & 0xff);
  return out;
}

inline std::string z16_guid() {
  return std::string("Z16 ") + std::string("\x00\x00\x10\x00\x80\x00\x00\xaa\x00\x38\x9b\x71", 12);
}

/// Class-specific descriptors of a VideoStreaming interface with one uncompressed format of one frame size.
inline std::string streaming_descriptors(int width_px, int height_px, const std::string& guid = z16_guid(),
                                         std::uint8_t endpoint = 0x81) {
  const auto byte = [](int v) { return std::string(1, static_cast<char>(v)); };
  const std::uint32_t frame_bytes = 2u * static_cast<std::uint32_t>(width_px * height_px);
  std::string header = byte(14) + byte(0x24) + byte(0x01) + byte(1) + little_endian(14 + 27 + 30, 2) +
                       byte(endpoint) + byte(0) + byte(3) + byte(0) + byte(0) + byte(0) + byte(1) + byte(0);
  std::string format = byte(27) + byte(0x24) + byte(0x04) + byte(2) + byte(1) + guid + byte(16) + byte(1) +
                       byte(0) + byte(0) + byte(0) + byte(0);
  std::string frame = byte(30) + byte(0x24) + byte(0x05) + byte(3) + byte(0) +
                      little_endian(static_cast<std::uint32_t>(width_px), 2) +
                      little_endian(static_cast<std::uint32_t>(height_px), 2) + little_endian(1000000, 4) +
                      little_endian(9000000, 4) + little_endian(frame_bytes, 4) + little_endian(333333, 4) +
                      byte(1) + little_endian(333333, 4);
  return header + format + frame;
}

/// A whole configuration: control interface 0, streaming interface 1 with its endpoint.
inline std::string depth_configuration(const std::string& streaming, int endpoint_type = 2) {
  const auto byte = [](int v) { return std::string(1, static_cast<char>(v)); };
  const std::string interfaces = byte(9) + byte(4) + byte(0) + byte(0) + byte(0) + byte(0x0e) + byte(1) +
                                 byte(0) + byte(0) + byte(9) + byte(4) + byte(1) + byte(0) + byte(1) +
                                 byte(0x0e) + byte(2) + byte(0) + byte(0) + streaming + byte(7) + byte(5) +
                                 byte(0x81) + byte(endpoint_type) + little_endian(512, 2) + byte(1);
  return byte(9) + byte(2) + little_endian(9 + static_cast<std::uint32_t>(interfaces.size()), 2) + byte(2) +
         byte(1) + byte(0) + byte(0x80) + byte(50) + interfaces;
}

/// A frame as payloads of at most `data_bytes` behind a header of 12 bytes with presentation time and source
/// clock.
inline std::vector<std::string> payloads_of(const std::string& frame, bool toggle, std::uint32_t ticks,
                                            std::size_t data_bytes) {
  std::vector<std::string> payloads;
  for (std::size_t at = 0; at < frame.size(); at += data_bytes) {
    const bool last = at + data_bytes >= frame.size();
    std::string header(1, 12);
    header += static_cast<char>(0x80 | 0x08 | 0x04 | (last ? 0x02 : 0) | (toggle ? 1 : 0));
    header += little_endian(ticks, 4) + std::string(6, '\0');
    payloads.push_back(header + frame.substr(at, data_bytes));
  }
  return payloads;
}

inline std::string z16_bytes(const std::vector<std::uint16_t>& units) {
  std::string bytes;
  for (const std::uint16_t u : units) bytes += little_endian(u, 2);
  return bytes;
}

}  // namespace gnathion
