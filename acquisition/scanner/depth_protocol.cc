#include "acquisition/scanner/depth_protocol.h"

#include <fmt/format.h>

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot read depth";
constexpr std::string_view kZ16("Z16 \x00\x00\x10\x00\x80\x00\x00\xaa\x00\x38\x9b\x71", 16);
constexpr std::uint8_t kClassInterface = 0x24;  // CS_INTERFACE
constexpr std::uint8_t kInputHeader = 0x01, kFormatUncompressed = 0x04, kFrameUncompressed = 0x05;
constexpr int kLargestSide = 8192;
// Bits of a payload's bmHeaderInfo.
constexpr std::uint8_t kToggle = 0x01, kEndOfFrame = 0x02, kHasTime = 0x04, kError = 0x40;

std::uint8_t byte_at(std::string_view bytes, std::size_t i) {
  return static_cast<std::uint8_t>(bytes[i]);
}
std::uint32_t little(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint32_t value = 0;
  for (std::size_t k = count; k-- > 0;) value = (value << 8) | byte_at(bytes, at + k);
  return value;
}
void put(std::string& out, std::uint32_t value, std::size_t count) {
  for (std::size_t k = 0; k < count; ++k) out += static_cast<char>((value >> (8 * k)) & 0xff);
}

}  // namespace

Result<DepthImage> decode_z16(std::string_view bytes, int width_px, int height_px) {
  if (width_px < 1 || height_px < 1 || width_px > kLargestSide || height_px > kLargestSide)
    return bad_input(kWhat, "Z16 frame", fmt::format("an impossible size: {}x{}", width_px, height_px));
  const std::size_t pixels = static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
  if (bytes.size() != 2 * pixels)
    return bad_input(kWhat, "Z16 frame",
                     fmt::format("{} bytes, {}x{} has {}", bytes.size(), width_px, height_px, 2 * pixels));
  DepthImage image;
  image.width_px = width_px;
  image.height_px = height_px;
  image.units.resize(pixels);
  for (std::size_t i = 0; i < pixels; ++i)
    image.units[i] = static_cast<std::uint16_t>(little(bytes, 2 * i, 2));
  return image;
}

Result<DepthModes> parse_depth_modes(std::string_view bytes) {
  const auto bad = [](const std::string& why) { return bad_input(kWhat, "UVC descriptors", why); };
  DepthModes found;
  std::optional<std::uint8_t> format;  // the Z16 format that the next frames belong to
  for (std::size_t at = 0; at < bytes.size();) {
    const std::size_t length = byte_at(bytes, at);
    if (length < 2 || length > bytes.size() - at)
      return bad(fmt::format("a descriptor of {} bytes where {} are left", length, bytes.size() - at));
    const std::string_view d = bytes.substr(at, length);
    at += length;
    if (byte_at(d, 1) != kClassInterface || length < 3) continue;
    const std::uint8_t kind = byte_at(d, 2);
    if (kind == kInputHeader) {
      if (length < 7) return bad("an input header that is cut");
      found.endpoint = byte_at(d, 6);
    } else if (kind == kFormatUncompressed) {
      if (length < 22) return bad("an uncompressed format that is cut");
      format.reset();
      if (d.substr(5, 16) == kZ16) format = byte_at(d, 3);
    } else if (kind == kFrameUncompressed && format) {
      if (length < 25) return bad("a frame descriptor that is cut");
      const DepthMode mode{*format, byte_at(d, 3), static_cast<int>(little(d, 5, 2)),
                           static_cast<int>(little(d, 7, 2)), little(d, 21, 4)};
      if (mode.width_px < 1 || mode.height_px < 1 || mode.width_px > kLargestSide ||
          mode.height_px > kLargestSide)
        return bad(fmt::format("a depth frame of {}x{} pixels", mode.width_px, mode.height_px));
      found.modes.push_back(mode);
    } else if (kind != kFrameUncompressed && kind != 0x03 && kind != 0x0d) {
      format.reset();  // another format begins; still images and colour matching belong to the last one
    }
  }
  return found;
}

std::string format_stream_control(const StreamControl& c) {
  std::string out;
  put(out, 1, 2);  // the frame interval is to be kept
  put(out, c.format, 1);
  put(out, c.frame, 1);
  put(out, c.interval_100ns, 4);
  put(out, 0, 10);
  put(out, c.frame_bytes, 4);
  put(out, c.payload_bytes, 4);
  return out;
}

std::optional<StreamControl> parse_stream_control(std::string_view bytes) {
  if (bytes.size() < 26) return std::nullopt;
  return StreamControl{byte_at(bytes, 2), byte_at(bytes, 3), little(bytes, 4, 4), little(bytes, 18, 4),
                       little(bytes, 22, 4)};
}

void PayloadAssembler::begin(bool toggle) {
  toggle_ = toggle;
  bytes_.clear();
  ticks_.reset();
  broken_ = done_ = false;
}

PayloadAssembler::Outcome PayloadAssembler::add(std::string_view payload) {
  Outcome outcome;
  if (payload.empty()) return outcome;  // a transfer without data between frames
  const std::size_t header = byte_at(payload, 0);
  if (header < 2 || header > payload.size()) {
    broken_ = true;
    if (payload.size() > 0)
      outcome.lost = fmt::format("a payload header of {} bytes in {}", header, payload.size());
    return outcome;
  }
  const std::uint8_t info = byte_at(payload, 1);
  const bool toggle = (info & kToggle) != 0;
  // The first frame may have begun before us; only a change of the toggle says where one begins.
  if (!toggle_) {
    begin(toggle);
    broken_ = false;
  } else if (*toggle_ != toggle) {
    if (!done_ && !broken_ && !bytes_.empty())
      outcome.lost = fmt::format("frame cut: {} of {} bytes", bytes_.size(), frame_bytes_);
    begin(toggle);
  }
  if (info & kError) {
    if (!broken_) outcome.lost = "the camera reports an error in the frame";
    broken_ = true;
  }
  if ((info & kHasTime) && header >= 6) ticks_ = little(payload, 2, 4);
  const std::string_view data = payload.substr(header);
  if (!broken_ && !done_) {
    if (data.size() > frame_bytes_ - bytes_.size()) {
      broken_ = true;
      outcome.lost = fmt::format("frame too long: more than {} bytes", frame_bytes_);
    } else {
      bytes_.append(data);
    }
  }
  if (!(info & kEndOfFrame) || done_) return outcome;
  done_ = true;
  if (broken_) return outcome;
  if (bytes_.size() != frame_bytes_) {
    outcome.lost = fmt::format("frame cut: {} of {} bytes", bytes_.size(), frame_bytes_);
    return outcome;
  }
  outcome.frame = std::move(bytes_);
  outcome.device_ticks = ticks_;
  bytes_.clear();
  return outcome;
}

}  // namespace gnathion
