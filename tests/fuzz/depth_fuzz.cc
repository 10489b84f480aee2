// A depth camera that lies: descriptors, stream control, payloads, frames.
#include <algorithm>
#include <cstdint>
#include <string_view>

#include "acquisition/scanner/depth_protocol.h"
#include "core/check.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace gnathion;
  if (size < 3) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  if (const auto modes = parse_depth_modes(bytes))
    for (const DepthMode& m : modes->modes) GNATHION_CHECK(m.width_px > 0 && m.height_px > 0);
  if (const auto control = parse_stream_control(bytes)) {
    const auto again = parse_stream_control(format_stream_control(*control));
    GNATHION_CHECK(again && again->format == control->format &&
                   again->payload_bytes == control->payload_bytes);
  }
  // The first bytes say how the rest is cut: a frame of width·height pixels, payloads of a length each.
  const int width = data[0] % 16 + 1, height = data[1] % 16 + 1;
  const std::size_t frame_bytes = 2u * static_cast<std::size_t>(width * height);
  PayloadAssembler assembler(frame_bytes);
  for (std::size_t at = 3; at < size;) {
    const std::size_t length = std::min<std::size_t>(data[at] + 1u, size - at);
    const auto outcome = assembler.add(bytes.substr(at, length));
    if (outcome.frame)
      GNATHION_CHECK(outcome.frame->size() == frame_bytes && decode_z16(*outcome.frame, width, height));
    at += length;
  }
  (void)decode_z16(bytes, width, height);
  return 0;
}
