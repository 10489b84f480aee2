#include "acquisition/usb/polhemus_protocol.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace gnathion {
namespace {

constexpr std::size_t kHeaderSize = 8;
constexpr int kMaxStation = 16;             // Liberty 240/16 has most
constexpr std::size_t kMaxReply = 2048;     // "who am I" is the longest, some 300 bytes
constexpr std::size_t kGarbageLine = 4096;  // endless garbage is told in pieces of this size
constexpr char kContinuous = 'C';

/// The command that pose records of a running tracker name; either case starts it.
bool is_continuous(char command) {
  return command == 'C' || command == 'c';
}

std::uint32_t u32(const char* p) {
  std::array<unsigned char, 4> b;
  std::memcpy(b.data(), p, 4);
  return b[0] | (std::uint32_t{b[1]} << 8) | (std::uint32_t{b[2]} << 16) | (std::uint32_t{b[3]} << 24);
}
float f32(const char* p) {
  const std::uint32_t bits = u32(p);
  float value;
  std::memcpy(&value, &bits, 4);
  return value;
}
std::size_t size_of(std::string_view header) {
  return static_cast<unsigned char>(header[6]) | (std::size_t{static_cast<unsigned char>(header[7])} << 8);
}

void put_u32(std::string& out, std::uint32_t v) {
  for (int shift = 0; shift < 32; shift += 8) out += static_cast<char>((v >> shift) & 0xff);
}
void put_f32(std::string& out, float value) {
  std::uint32_t bits;
  std::memcpy(&bits, &value, 4);
  put_u32(out, bits);
}

bool starts_with_tag(std::string_view bytes) {
  const std::string_view head = bytes.substr(0, 2);
  return head == std::string_view("LY").substr(0, head.size()) ||
         head == std::string_view("PA").substr(0, head.size());
}

/// Commands whose answers are read: letters, and the control letters of ^U (stations) and ^V (who am I).
bool is_command(unsigned char c) {
  return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c > 0 && c < 0x20) || c == '@';
}

PolhemusPose pose_from(std::string_view frame, const PolhemusFormat& format) {
  PolhemusPose pose;
  pose.station = static_cast<unsigned char>(frame[2]);
  pose.error = static_cast<std::uint8_t>(frame[4]);
  const char* p = frame.data() + kHeaderSize;
  pose.time_ms = u32(p);
  pose.frame = u32(p + 4);
  p += 8;
  if (format.distortion) {
    pose.distortion = static_cast<std::int32_t>(u32(p));
    p += 4;
  }
  for (int i = 0; i < 3; ++i) pose.position_cm[i] = f32(p + 4 * i);
  for (int i = 0; i < 4; ++i) pose.quaternion[i] = f32(p + 12 + 4 * i);
  return pose;
}

}  // namespace

std::string PolhemusFormat::command() const {
  return distortion ? "O*,8,9,11,2,7\r" : "O*,8,9,2,7\r";
}

/// As far as the bytes go.
bool PolhemusDecoder::may_be_pose_header(std::string_view bytes) const {
  const std::size_t n = bytes.size();
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
  return starts_with_tag(bytes) && (n < 3 || (byte(2) >= 1 && byte(2) <= kMaxStation)) &&
         (n < 4 || is_continuous(bytes[3])) && (n < 7 || byte(6) == format_.body_size()) &&
         (n < 8 || byte(7) == 0);
}

bool PolhemusDecoder::is_pose_header(std::string_view bytes) const {
  return bytes.size() >= kHeaderSize && may_be_pose_header(bytes.substr(0, kHeaderSize));
}

/// A record that another one starts in was cut. The header may reach beyond the record's end, or be cut
/// itself: three bytes of one at the end of a quaternion would be a number of 1e-38.
bool PolhemusDecoder::is_cut(std::string_view rest, std::size_t size) const {
  if (rest.size() >= size)
    for (std::size_t at = size - (kHeaderSize - 1); at + 3 <= size; ++at)
      if (may_be_pose_header(rest.substr(at, size - at))) return true;
  for (std::size_t at = 1; at < size && at + kHeaderSize <= rest.size(); ++at)
    if (is_pose_header(rest.substr(at))) return true;
  return false;
}

/// Its end looks like the start of another one, which only the next bytes can tell.
bool PolhemusDecoder::may_be_cut(std::string_view rest, std::size_t size) const {
  for (std::size_t at = size - (kHeaderSize - 1); at < size; ++at)
    if (rest.size() - at < kHeaderSize && may_be_pose_header(rest.substr(at))) return true;
  return false;
}

PolhemusDecoder::Look PolhemusDecoder::look_at(std::string_view rest, bool more_comes, PolhemusRecord& record,
                                               std::size_t& size) const {
  if (!starts_with_tag(rest)) return Look::kGarbage;
  if (rest.size() < kHeaderSize) return Look::kNeedMore;
  size = kHeaderSize + size_of(rest);
  const bool pose = is_pose_header(rest);
  if (!pose) {
    const auto command = static_cast<unsigned char>(rest[3]);
    if (is_continuous(rest[3]) || !is_command(command) || size > kHeaderSize + kMaxReply)
      return Look::kGarbage;
  }
  if (is_cut(rest, size)) return Look::kGarbage;
  if (rest.size() < size || (more_comes && may_be_cut(rest, size))) return Look::kNeedMore;
  const bool followed = starts_with_tag(rest.substr(size));  // by a record or, so far, by nothing
  if (pose) {
    const PolhemusPose read = pose_from(rest, format_);
    if (!followed && !is_plausible(read)) return Look::kGarbage;
    record = read;
    return Look::kRecord;
  }
  if (!followed) return Look::kGarbage;
  record = PolhemusReply{static_cast<unsigned char>(rest[2]), static_cast<std::uint8_t>(rest[3]),
                         static_cast<std::uint8_t>(rest[4]),
                         std::string(rest.substr(kHeaderSize, size - kHeaderSize))};
  return Look::kRecord;
}

void PolhemusDecoder::tell_garbage(std::vector<PolhemusRecord>& out) {
  if (garbage_ > 0) out.push_back(PolhemusGarbage{garbage_});
  garbage_ = 0;
}

void PolhemusDecoder::feed(std::string_view bytes, std::vector<PolhemusRecord>& out) {
  buffer_.append(bytes);
  cut_up(true, out);
}

void PolhemusDecoder::cut_up(bool more_comes, std::vector<PolhemusRecord>& out) {
  std::size_t at = 0;
  while (at < buffer_.size()) {
    PolhemusRecord record;
    std::size_t size = 0;
    const Look look = look_at(std::string_view(buffer_).substr(at), more_comes, record, size);
    if (look == Look::kNeedMore) break;
    if (look == Look::kGarbage) {
      ++at;
      if (++garbage_ >= kGarbageLine) tell_garbage(out);
      continue;
    }
    tell_garbage(out);
    out.push_back(std::move(record));
    at += size;
  }
  buffer_.erase(0, at);
}

void PolhemusDecoder::flush(std::vector<PolhemusRecord>& out) {
  cut_up(false, out);
  garbage_ += buffer_.size();
  buffer_.clear();
  tell_garbage(out);
}

std::optional<std::string> polhemus_error(std::uint8_t indicator) {
  switch (indicator) {
    case 0x00:
    case ' ':
      return std::nullopt;
    case 0x01:
      return "invalid command";
    case 0x02:
      return "invalid station";
    case 0x03:
      return "invalid parameter";
    case 0x04:
      return "too few parameters";
    case 0x05:
      return "too many parameters";
    case 0x06:
      return "parameter below limit";
    case 0x07:
      return "parameter above limit";
    case 0x08:
      return "no communication with the sensor processor board";
    case 0x09:
    case 0x0a:
    case 0x0b:
    case 0x0c:
      return "sensor processor " + std::to_string(indicator - 8) + " did not start";
    case 0x0d:
      return "no sensor processors";
    case 0x0e:
      return "source processor did not start";
    case 0x0f:
      return "tracker out of memory";
    case 0x10:
      return "too many characters in a command";
    case 0x12:
      return "source memory unreadable, defaults used";
    case 0x13:
      return "read-only command";
    case 0x15:
      return "map not loaded";
    case 'u':
      return "outside the mapped area";
    case 'I':
      return "self-test errors";
    default:
      break;
  }
  static constexpr const char* kAxes[] = {"", "x", "y", "xy", "z", "xz", "yz", "xyz"};
  if (indicator >= 'a' && indicator <= 'g')
    return std::string("source failed in ") + kAxes[indicator - 'a' + 1];
  if (indicator >= 'A' && indicator <= 'G')
    return std::string("source failed in ") + kAxes[indicator - 'A' + 1] + ", with self-test errors";
  return "error indicator " + std::to_string(indicator);
}

bool is_plausible(const PolhemusPose& pose) {
  double squares = 0;
  for (const float q : pose.quaternion) squares += static_cast<double>(q) * static_cast<double>(q);
  for (const float p : pose.position_cm)
    if (!std::isfinite(p)) return false;
  return std::abs(squares - 1) < 2e-3;  // false for NaN
}

std::string encode(const PolhemusReply& reply, std::string_view tag) {
  std::string out(tag);
  out += static_cast<char>(reply.station);
  out += static_cast<char>(reply.command);
  out += static_cast<char>(reply.error);
  out += '\0';
  out += static_cast<char>(reply.body.size() & 0xff);
  out += static_cast<char>(reply.body.size() >> 8);
  return out + reply.body;
}

std::string encode(const PolhemusPose& pose, const PolhemusFormat& format, std::string_view tag) {
  PolhemusReply frame{pose.station, kContinuous, pose.error, {}};
  put_u32(frame.body, pose.time_ms);
  put_u32(frame.body, pose.frame);
  if (format.distortion) put_u32(frame.body, static_cast<std::uint32_t>(pose.distortion));
  for (const float p : pose.position_cm) put_f32(frame.body, p);
  for (const float q : pose.quaternion) put_f32(frame.body, q);
  return encode(frame, tag);
}

std::int64_t PolhemusFrameTimer::time_ns(std::uint32_t time_ms, std::uint32_t frame) {
  const double of_frame = period_ms_ * frame;
  const double low = time_ms - of_frame;
  constexpr double kRounding = 1e-5;
  if (high_ms_ < low_ms_) {
    low_ms_ = low;
    high_ms_ = low + 1;
  } else {
    low_ms_ = std::max(low_ms_, low - kRounding);
    high_ms_ = std::min(high_ms_, low + 1 + kRounding);
    if (high_ms_ < low_ms_) {
      if (rate_holds()) ++contradictions_;
      low_ms_ = low;
      high_ms_ = low + 1;
    }
  }
  const double ms = rate_holds() ? of_frame + (low_ms_ + high_ms_) / 2 : time_ms + 0.5;
  return static_cast<std::int64_t>(std::llround(ms * 1e6));
}

}  // namespace gnathion
