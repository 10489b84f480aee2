#include "acquisition/igtl/igtl_protocol.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>

#include "acquisition/igtl/igtl_bytes.h"
#include "core/check.h"

namespace gnathion::igtl {
namespace {

constexpr std::uint64_t kPolynomial = 0x42F0E1EBA9EA3693ULL;
constexpr std::size_t kTypeBytes = 12, kDeviceBytes = 20;
constexpr std::size_t kExtendedHeaderBytes = 12;

/// table[k][i]: the byte i, followed by k zero bytes. Eight bytes are taken at once, since images come at a
/// hundred megabytes a second.
using CrcTables = std::array<std::array<std::uint64_t, 256>, 8>;
CrcTables crc_tables() {
  CrcTables table{};
  for (std::uint64_t i = 0; i < 256; ++i) {
    std::uint64_t crc = i << 56;
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 63 ? crc << 1 ^ kPolynomial : crc << 1;
    table[0][i] = crc;
  }
  for (std::size_t k = 1; k < 8; ++k)
    for (std::size_t i = 0; i < 256; ++i)
      table[k][i] = table[0][table[k - 1][i] >> 56] ^ table[k - 1][i] << 8;
  return table;
}

/// Upper-case letters, digits and '_', padded with NUL: all types of the protocol, and what others invent.
bool is_type_field(std::string_view field) {
  std::size_t n = 0;
  while (n < field.size() && (std::isupper(static_cast<unsigned char>(field[n])) ||
                              std::isdigit(static_cast<unsigned char>(field[n])) || field[n] == '_'))
    ++n;
  return n >= 2 && field.find_first_not_of('\0', n) == std::string_view::npos;
}

/// Text up to the first NUL. Behind it some senders leave what was there before; a message without a body,
/// whose checksum says nothing, must have NULs there, or any run of zeros would be one.
bool is_device_field(std::string_view field, bool has_body) {
  const std::size_t end = std::min(field.find('\0'), field.size());
  for (const char c : field.substr(0, end))
    if (static_cast<unsigned char>(c) < 0x20) return false;
  return has_body || field.find_first_not_of('\0', end) == std::string_view::npos;
}

/// The largest body that a type of small messages has, so that a lying length is seen at once.
std::uint64_t ceiling(const Header& h, std::uint64_t max_body_bytes) {
  constexpr std::uint64_t kMetadata = 64 << 10;
  const std::uint64_t beside = h.version >= 2 ? kMetadata : 0;
  if (h.type == "TRANSFORM") return std::min(max_body_bytes, 48 + beside);
  if (h.type == "TDATA" || h.type == "QTDATA" || h.type == "STATUS")
    return std::min<std::uint64_t>(max_body_bytes, 1 << 20);
  return max_body_bytes;
}

}  // namespace

std::string text_field(std::string_view b, std::size_t at, std::size_t count) {
  std::string_view field = b.substr(at, count);
  field = field.substr(0, field.find('\0'));
  std::string text(field);
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) > 0x7e) c = '?';
  return text;
}

std::uint64_t crc64(std::string_view bytes) {
  static const CrcTables table = crc_tables();
  std::uint64_t crc = 0;
  std::size_t at = 0;
  for (; at + 8 <= bytes.size(); at += 8) {
    const std::uint64_t x = crc ^ u64(bytes, at);
    crc = 0;
    for (std::size_t k = 0; k < 8; ++k) crc ^= table[k][x >> (8 * k) & 0xff];
  }
  for (; at < bytes.size(); ++at)
    crc = table[0][(crc >> 56 ^ static_cast<unsigned char>(bytes[at])) & 0xff] ^ crc << 8;
  return crc;
}

std::int64_t Header::timestamp_ns() const {
  const auto seconds = static_cast<std::int64_t>(timestamp >> 32);
  const std::uint64_t fraction = timestamp & 0xffffffffULL;
  return seconds * 1'000'000'000 + static_cast<std::int64_t>((fraction * 1'000'000'000 + (1ULL << 31)) >> 32);
}

HeaderCheck read_header(std::string_view bytes, std::uint64_t max_body_bytes) {
  GNATHION_CHECK(bytes.size() >= kHeaderBytes);
  HeaderCheck check;
  Header& h = check.header;
  h.version = u16(bytes, 0);
  if (h.version < 1 || h.version > 3) {  // 3.x libraries write 2; nobody writes more
    check.fault = fmt::format("version {}", h.version);
    return check;
  }
  h.type = text_field(bytes, 2, kTypeBytes);
  h.device = text_field(bytes, 14, kDeviceBytes);
  h.timestamp = u64(bytes, 34);
  h.body_bytes = u64(bytes, 42);
  h.crc = u64(bytes, 50);
  if (!is_type_field(bytes.substr(2, kTypeBytes)))
    check.fault = "a type that is no name";
  else if (!is_device_field(bytes.substr(14, kDeviceBytes), h.body_bytes > 0))
    check.fault = "a device name that is no text";
  else if (const std::uint64_t most = ceiling(h, max_body_bytes); h.body_bytes > most)
    check.fault = fmt::format("{} announces {} bytes; {} at most", h.type, h.body_bytes, most);
  return check;
}

void Framer::consume(std::size_t n) {
  begin_ += n;
  if (begin_ == buffer_.size()) {
    buffer_.clear();
    begin_ = 0;
  } else if (begin_ > (64u << 10) && begin_ > buffer_.size() / 2) {
    buffer_.erase(0, begin_);
    begin_ = 0;
  }
}

void Framer::pass_over(std::size_t n) {
  skipped_bytes_ += n;
  consume(n);
}

std::optional<Item> Framer::told_skips() {
  const std::uint64_t stray =
      skipped_bytes_ > tolerated_bytes_ ? skipped_bytes_ - tolerated_bytes_ : std::uint64_t{0};
  skipped_bytes_ = tolerated_bytes_ = 0;
  std::string fault;
  fault.swap(fault_);
  if (stray == 0) return std::nullopt;
  Item item;
  item.kind = Item::Kind::kRejected;
  item.header = fault_header_;
  item.reason = fault.empty() ? fmt::format("{} bytes are no message", stray)
                              : fmt::format("{} bytes are no message: {}", stray, fault);
  return item;
}

Item Framer::rejected(const Header& header, std::string reason, std::size_t its_bytes) {
  in_step_ = false;
  tolerated_bytes_ += its_bytes;
  pass_over(1);
  return {Item::Kind::kRejected, header, {}, std::move(reason)};
}

std::optional<Item> Framer::next() {
  while (true) {
    const std::string_view bytes = rest();
    if (bytes.size() < kHeaderBytes) {
      if (!finished_) return std::nullopt;
      if (in_step_) fault_ = "cut off";
      in_step_ = false;
      pass_over(bytes.size());
      return told_skips();
    }
    const HeaderCheck check = read_header(bytes, max_body_bytes_);
    if (!check.fault.empty()) {
      if (in_step_) {
        fault_ = check.fault;
        fault_header_ = check.header;
        in_step_ = false;
      }
      pass_over(1);
      continue;
    }
    const std::size_t total = kHeaderBytes + static_cast<std::size_t>(check.header.body_bytes);
    if (bytes.size() < total) {
      if (!finished_) return std::nullopt;
      if (!in_step_) {
        pass_over(1);
        continue;
      }
      return rejected(check.header, fmt::format("cut off after {} of {} bytes", bytes.size(), total),
                      bytes.size());
    }
    const std::string_view body = bytes.substr(kHeaderBytes, total - kHeaderBytes);
    if (crc64(body) == check.header.crc) {
      if (auto skips = told_skips()) return skips;
      Item item{Item::Kind::kMessage, check.header, std::string(body), {}};
      in_step_ = true;
      futile_bytes_ = 0;
      consume(total);
      return item;
    }
    // Headers that only look like some would cost a checksum of all that follows for each of their bytes.
    futile_bytes_ += total;
    if (futile_bytes_ > 4 * max_body_bytes_) {
      futile_bytes_ = 0;
      pass_over(bytes.size());
      continue;
    }
    if (in_step_) return rejected(check.header, "checksum of the body is wrong", total);
    pass_over(1);
  }
}

/// Where the first whole message behind the start of the buffer begins; 0: there is none.
std::size_t Framer::whole_message_after_first_byte() const {
  const std::string_view bytes = rest();
  std::uint64_t checked_bytes = 0;
  for (std::size_t at = 1; at + kHeaderBytes <= bytes.size(); ++at) {
    // Nearly every place of a picture or a mesh fails here, long before its fields are read.
    if (bytes[at] != 0 || !std::isupper(static_cast<unsigned char>(bytes[at + 2]))) continue;
    const HeaderCheck check = read_header(bytes.substr(at), max_body_bytes_);
    // A message without a body has no checksum to prove it.
    if (!check.fault.empty() || check.header.body_bytes == 0) continue;
    if (check.header.body_bytes > bytes.size() - at - kHeaderBytes) continue;
    const auto body_bytes = static_cast<std::size_t>(check.header.body_bytes);
    if (crc64(bytes.substr(at + kHeaderBytes, body_bytes)) == check.header.crc) return at;
    checked_bytes += body_bytes;
    if (checked_bytes > 4 * max_body_bytes_) return 0;
  }
  return 0;
}

std::optional<Item> Framer::give_up_if_overtaken() {
  const std::size_t at = whole_message_after_first_byte();
  if (at == 0) return std::nullopt;
  if (!in_step_) {
    pass_over(at);
    return told_skips();
  }
  const Header header = read_header(rest(), max_body_bytes_).header;
  Item item = rejected(
      header, fmt::format("announces {} bytes; after {} another message begins", header.body_bytes, at), at);
  pass_over(at - 1);
  return item;
}

Result<Content> content_of(const Header& header, std::string_view body) {
  constexpr const char* what = "cannot read OpenIGTLink message";
  if (header.version < 2) return Content{body, 0, {}};
  if (body.size() < kExtendedHeaderBytes)
    return bad_input(what, header.type, "too short for its extended header");
  const std::size_t extended = u16(body, 0), index = u16(body, 2), values = u32(body, 4);
  if (extended < kExtendedHeaderBytes || extended + index + values > body.size())
    return bad_input(what, header.type,
                     fmt::format("extended header of {} and metadata of {} + {} bytes in a body of {}",
                                 extended, index, values, body.size()));
  Content content;
  content.message_id = u32(body, 8);
  content.bytes = body.substr(extended, body.size() - extended - index - values);
  const std::string_view metadata = body.substr(body.size() - index - values);
  if (index < 2) return content;
  const std::size_t count = u16(metadata, 0);
  if (2 + 8 * count > index) return bad_input(what, header.type, "metadata index is cut off");
  std::size_t at = index;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t key_bytes = u16(metadata, 2 + 8 * i), value_bytes = u32(metadata, 6 + 8 * i);
    if (key_bytes + value_bytes > metadata.size() - at)
      return bad_input(what, header.type, "metadata is cut off");
    content.metadata[text_field(metadata, at, key_bytes)] = text_field(metadata, at + key_bytes, value_bytes);
    at += key_bytes + value_bytes;
  }
  return content;
}

std::string pack(const std::string& type, const std::string& device, std::string_view body,
                 std::uint64_t timestamp) {
  std::string out;
  append_big_endian(out, 1, 2);
  const auto field = [&](std::string text, std::size_t count) {
    text.resize(count, '\0');
    out += text;
  };
  field(type, kTypeBytes);
  field(device, kDeviceBytes);
  append_big_endian(out, timestamp, 8);
  append_big_endian(out, body.size(), 8);
  append_big_endian(out, crc64(body), 8);
  out += body;
  return out;
}

std::string start_tracking_body(std::int32_t interval_ms, const std::string& coordinate_system) {
  std::string body, name = coordinate_system;
  append_big_endian(body, static_cast<std::uint32_t>(interval_ms), 4);
  name.resize(32, '\0');
  return body + name;
}

}  // namespace gnathion::igtl
