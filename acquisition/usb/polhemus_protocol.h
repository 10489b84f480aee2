// The binary protocol of the Polhemus Patriot and Liberty: bytes in, records out. No I/O, no clock.
//
// A record is an 8-byte header (tag "LY" or "PA", station, initiating command, error indicator, reserved,
// size of the body as little-endian u16) and its body. Sources: docs/devices/polhemus.md.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace gnathion {

/// What a pose record holds: the list that is sent with the command 'O'.
struct PolhemusFormat {
  bool distortion = false;
  /// "O*,8,9,2,7\r": time stamp, frame count, [distortion,] position, quaternion.
  std::string command() const;
  std::size_t body_size() const { return distortion ? 40 : 36; }
};

/// One sensor in one frame, in the units that were set: centimetres.
struct PolhemusPose {
  int station = 0;         ///< 1…16
  std::uint8_t error = 0;  ///< see polhemus_error()
  std::uint32_t time_ms = 0, frame = 0;
  std::int32_t distortion = 0;
  float position_cm[3] = {0, 0, 0};    ///< in the transmitter's frame
  float quaternion[4] = {1, 0, 0, 0};  ///< w x y z: transmitter from sensor
};
/// The answer to a command.
struct PolhemusReply {
  int station = 0;
  std::uint8_t command = 0, error = 0;
  std::string body;
};
/// Bytes that belong to no record.
struct PolhemusGarbage {
  std::size_t bytes = 0;
};
using PolhemusRecord = std::variant<PolhemusPose, PolhemusReply, PolhemusGarbage>;

/// Cuts the stream into records and finds the next one after garbage or a cut record. Memory is bounded.
class PolhemusDecoder {
 public:
  explicit PolhemusDecoder(PolhemusFormat format = {}) : format_(format) {}
  void feed(std::string_view bytes, std::vector<PolhemusRecord>& out);
  /// The stream is over or was interrupted: what is left is garbage.
  void flush(std::vector<PolhemusRecord>& out);

 private:
  enum class Look { kRecord, kGarbage, kNeedMore };
  void cut_up(bool more_comes, std::vector<PolhemusRecord>& out);
  Look look_at(std::string_view rest, bool more_comes, PolhemusRecord& record, std::size_t& size) const;
  bool may_be_pose_header(std::string_view bytes) const;
  bool is_pose_header(std::string_view bytes) const;
  bool is_cut(std::string_view rest, std::size_t size) const;
  bool may_be_cut(std::string_view rest, std::size_t size) const;
  void tell_garbage(std::vector<PolhemusRecord>& out);

  PolhemusFormat format_;
  std::string buffer_;
  std::size_t garbage_ = 0;
};

/// What an error indicator means; nothing for 0 and ' ', which mean no error.
std::optional<std::string> polhemus_error(std::uint8_t indicator);
/// True for a unit quaternion, up to rounding, and a finite position.
bool is_plausible(const PolhemusPose& pose);

/// The bytes of a record, for tests and mock instruments.
std::string encode(const PolhemusPose& pose, const PolhemusFormat& format, std::string_view tag = "LY");
std::string encode(const PolhemusReply& reply, std::string_view tag = "LY");

/// The time of frames in ns, finer than the whole milliseconds of their time stamps: frames come at a fixed
/// rate and time stamps are their times rounded down, so every pair bounds the offset between the two counts.
class PolhemusFrameTimer {
 public:
  explicit PolhemusFrameTimer(double rate_hz) : period_ms_(1000.0 / rate_hz) {}
  std::int64_t time_ns(std::uint32_t time_ms, std::uint32_t frame);
  /// False once the time stamps have contradicted the rate; times are then the stamps' own, to ±0.5 ms.
  bool rate_holds() const { return contradictions_ < 3; }

 private:
  double period_ms_;
  double low_ms_ = 0, high_ms_ = -1;  ///< bounds of (time − frame·period)
  int contradictions_ = 0;
};

}  // namespace gnathion
