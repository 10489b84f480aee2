// OpenIGTLink on the wire: headers, the cutting of a byte stream into messages, checksums. Pure decoding, no
// state of a connection.
//
// Sources: the protocol's pages at openigtlink.org (versions 1 to 3) and the headers of Debian's
// libopenigtlink. Its own unpacking trusts lengths inside bodies (docs/devices/openigtlink.md), so it is not
// used here; the tests use it as the independent writer.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "core/result.h"

namespace gnathion::igtl {

inline constexpr std::size_t kHeaderBytes = 58;

/// CRC-64 of a body: polynomial 0x42F0E1EBA9EA3693, from 0, most significant bit first.
std::uint64_t crc64(std::string_view bytes);

struct Header {
  std::uint16_t version = 1;    ///< 1: plain body; 2 and more: with an extended header
  std::string type;             ///< "TRANSFORM"
  std::string device;           ///< who speaks, at most 20 bytes
  std::uint64_t timestamp = 0;  ///< seconds since 1970, 32.32 fixed point; 0: not given
  std::uint64_t body_bytes = 0;
  std::uint64_t crc = 0;

  std::int64_t timestamp_ns() const;
};

/// The header at the start of `bytes` (at least kHeaderBytes), or why it cannot be one: a version or a type
/// that no sender writes, a body larger than its type can be or than `max_body_bytes`.
struct HeaderCheck {
  Header header;
  std::string fault;  ///< empty: plausible
};
HeaderCheck read_header(std::string_view bytes, std::uint64_t max_body_bytes);

/// A whole message with its own checksum, or what had to be thrown away.
struct Item {
  enum class Kind : std::uint8_t { kMessage, kRejected } kind = Kind::kMessage;
  Header header;       ///< of a rejected one as far as it could be read
  std::string body;    ///< of a message
  std::string reason;  ///< why rejected: "checksum of the body is wrong", "17 bytes are no message"
};

/// Cuts a byte stream into messages. Never allocates on the word of a header: the buffer grows with what has
/// come and holds at most one message. After a fault it looks for the next header, byte by byte, also inside
/// what a lying length had claimed, so that no whole message is lost.
class Framer {
 public:
  explicit Framer(std::uint64_t max_body_bytes = 64u << 20) : max_body_bytes_(max_body_bytes) {}
  void feed(std::string_view bytes) { buffer_.append(bytes); }
  /// The next item that is complete; nothing until more bytes come.
  std::optional<Item> next();
  /// The connection has ended: what is incomplete becomes rejected, whole messages inside it are still found
  /// by next().
  void finish() { finished_ = true; }
  /// For a message that has not come whole for long: where another whole one, with its checksum, stands
  /// inside what waits, the length announced was a lie; the waiting message is rejected and next() goes on
  /// with the other. Nothing when there is none: a large message on a slow line.
  std::optional<Item> give_up_if_overtaken();
  /// Bytes that wait for the rest of their message.
  std::size_t waiting_bytes() const { return buffer_.size() - begin_; }

 private:
  std::string_view rest() const { return std::string_view(buffer_).substr(begin_); }
  void consume(std::size_t n);
  void pass_over(std::size_t n);
  std::optional<Item> told_skips();
  Item rejected(const Header& header, std::string reason, std::size_t its_bytes);
  std::size_t whole_message_after_first_byte() const;
  std::uint64_t max_body_bytes_;
  std::string buffer_;
  std::size_t begin_ = 0;
  bool finished_ = false;
  bool in_step_ = true;  ///< the buffer starts where a message ended
  std::string fault_;    ///< what was wrong where the step was lost
  Header fault_header_;
  std::uint64_t skipped_bytes_ = 0;    ///< passed over since the last message
  std::uint64_t tolerated_bytes_ = 0;  ///< of them, remains of messages that were rejected by themselves
  std::uint64_t futile_bytes_ = 0;     ///< checksummed for nothing since the last message
};

/// A body taken apart: with version 1 all of it is content; later versions carry an extended header before
/// and metadata behind.
struct Content {
  std::string_view bytes;  ///< into the message's body
  std::uint32_t message_id = 0;
  std::map<std::string, std::string> metadata;
};
Result<Content> content_of(const Header& header, std::string_view body);

/// A message ready to send, version 1.
std::string pack(const std::string& type, const std::string& device, std::string_view body,
                 std::uint64_t timestamp = 0);
/// Body of STT_TDATA and STT_QTDATA: "send every `interval_ms`, in this coordinate system".
std::string start_tracking_body(std::int32_t interval_ms, const std::string& coordinate_system);

}  // namespace gnathion::igtl
