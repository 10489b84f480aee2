#include "acquisition/mcap_format.h"

#include <lz4frame.h>
#include <zlib.h>
#include <zstd.h>

#include <cstring>
#include <memory>

#include "core/check.h"

namespace gnathion::mcap {
namespace {

/// Appends little-endian fields.
class Writer {
 public:
  template <class T>
  Writer& number(T value) {
    for (std::size_t i = 0; i < sizeof(T); ++i)
      bytes_.push_back(static_cast<char>((static_cast<std::uint64_t>(value) >> (8 * i)) & 0xff));
    return *this;
  }
  Writer& text(std::string_view s) {
    number(static_cast<std::uint32_t>(s.size()));
    bytes_.append(s);
    return *this;
  }
  Writer& raw(std::string_view s) {
    bytes_.append(s);
    return *this;
  }
  Writer& text_map(const std::map<std::string, std::string>& map) {
    Writer inner;
    for (const auto& [key, value] : map) inner.text(key).text(value);
    return text(inner.bytes_);
  }
  template <class K, class V>
  Writer& number_map(const std::map<K, V>& map) {
    Writer inner;
    for (const auto& [key, value] : map) inner.number(key).number(value);
    return text(inner.bytes_);
  }
  std::string record(Opcode opcode) const {
    Writer framed;
    framed.number(static_cast<std::uint8_t>(opcode)).number(static_cast<std::uint64_t>(bytes_.size()));
    return framed.bytes_ + bytes_;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

/// Reads little-endian fields; once something does not fit, everything after fails too.
class Reader {
 public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}
  template <class T>
  Reader& number(T& value) {
    const std::string_view field = take(sizeof(T));
    std::uint64_t v = 0;
    for (std::size_t i = 0; i < field.size(); ++i)
      v |= static_cast<std::uint64_t>(static_cast<unsigned char>(field[i])) << (8 * i);
    value = static_cast<T>(v);
    return *this;
  }
  template <class Length = std::uint32_t>
  Reader& view(std::string_view& value) {
    Length length = 0;
    number(length);
    value = take(static_cast<std::size_t>(length));
    return *this;
  }
  Reader& text(std::string& value) {
    std::string_view v;
    view(v);
    value.assign(v);
    return *this;
  }
  std::string_view rest() { return take(bytes_.size()); }
  bool at_end() const { return bytes_.empty(); }
  std::size_t left() const { return bytes_.size(); }
  bool ok() const { return ok_; }

 private:
  std::string_view take(std::size_t n) {
    if (!ok_ || n > bytes_.size()) {
      ok_ = false;
      return {};
    }
    const std::string_view field = bytes_.substr(0, n);
    bytes_.remove_prefix(n);
    return field;
  }
  std::string_view bytes_;
  bool ok_ = true;
};

template <class T>
std::optional<T> if_ok(const Reader& reader, T value) {
  if (!reader.ok()) return std::nullopt;
  return value;
}

}  // namespace

std::uint32_t crc32(std::string_view bytes, std::uint32_t crc) {
  while (!bytes.empty()) {
    const auto n = static_cast<uInt>(std::min<std::size_t>(bytes.size(), 1u << 30));
    crc = static_cast<std::uint32_t>(::crc32(crc, reinterpret_cast<const Bytef*>(bytes.data()), n));
    bytes.remove_prefix(n);
  }
  return crc;
}

std::string encode_header(const std::string& profile, const std::string& library) {
  return Writer().text(profile).text(library).record(Opcode::kHeader);
}
std::string encode(const Schema& s) {
  return Writer().number(s.id).text(s.name).text(s.encoding).text(s.data).record(Opcode::kSchema);
}
std::string encode(const Channel& c) {
  return Writer()
      .number(c.id)
      .number(c.schema_id)
      .text(c.topic)
      .text(c.message_encoding)
      .text_map(c.metadata)
      .record(Opcode::kChannel);
}
std::string encode(const Message& m) {
  return Writer()
      .number(m.channel_id)
      .number(m.sequence)
      .number(m.log_time)
      .number(m.publish_time)
      .raw(m.data)
      .record(Opcode::kMessage);
}
void append_message(std::string& out, const Message& m, std::string_view body) {
  constexpr std::uint64_t kFields = 2 + 4 + 8 + 8;
  Writer head;
  head.number(static_cast<std::uint8_t>(Opcode::kMessage));
  head.number(kFields + m.data.size() + body.size());
  head.number(m.channel_id).number(m.sequence).number(m.log_time).number(m.publish_time);
  out.append(head.bytes()).append(m.data).append(body);
}
std::string encode_chunk_head(const Chunk& c, std::uint64_t compressed_size) {
  Writer fields;
  fields.number(c.start_time).number(c.end_time).number(c.uncompressed_size).number(c.uncompressed_crc);
  fields.text(c.compression).number(compressed_size);
  return Writer()
      .number(static_cast<std::uint8_t>(Opcode::kChunk))
      .number(static_cast<std::uint64_t>(fields.bytes().size()) + compressed_size)
      .raw(fields.bytes())
      .bytes();
}
std::string encode(const Chunk& c) {
  return encode_chunk_head(c, c.records.size()) + std::string(c.records);
}
std::string encode(const ChunkIndex& c) {
  return Writer()
      .number(c.start_time)
      .number(c.end_time)
      .number(c.chunk_offset)
      .number(c.chunk_length)
      .number_map(c.message_index_offsets)
      .number(c.message_index_length)
      .text(c.compression)
      .number(c.compressed_size)
      .number(c.uncompressed_size)
      .record(Opcode::kChunkIndex);
}
std::string encode(const Attachment& a) {
  Writer fields;
  fields.number(a.log_time)
      .number(a.create_time)
      .text(a.name)
      .text(a.media_type)
      .number(static_cast<std::uint64_t>(a.data.size()))
      .raw(a.data);
  fields.number(crc32(fields.bytes()));
  return fields.record(Opcode::kAttachment);
}
std::string encode(const AttachmentIndex& a) {
  return Writer()
      .number(a.offset)
      .number(a.length)
      .number(a.log_time)
      .number(a.create_time)
      .number(a.data_size)
      .text(a.name)
      .text(a.media_type)
      .record(Opcode::kAttachmentIndex);
}
std::string encode(const Statistics& s) {
  return Writer()
      .number(s.message_count)
      .number(s.schema_count)
      .number(s.channel_count)
      .number(s.attachment_count)
      .number(s.metadata_count)
      .number(s.chunk_count)
      .number(s.start_time)
      .number(s.end_time)
      .number_map(s.channel_message_counts)
      .record(Opcode::kStatistics);
}
std::string encode_message_index(std::uint16_t channel, const std::vector<MessageIndexEntry>& entries) {
  Writer inner;
  for (const auto& [time, offset] : entries) inner.number(time).number(offset);
  return Writer().number(channel).text(inner.bytes()).record(Opcode::kMessageIndex);
}
std::string encode_summary_offset(Opcode group, std::uint64_t start, std::uint64_t length) {
  return Writer()
      .number(static_cast<std::uint8_t>(group))
      .number(start)
      .number(length)
      .record(Opcode::kSummaryOffset);
}
std::string encode_data_end(std::uint32_t data_crc) {
  return Writer().number(data_crc).record(Opcode::kDataEnd);
}

std::string encode_footer(std::uint64_t summary_start, std::uint64_t summary_offset_start,
                          std::string_view summary) {
  Writer head;
  head.number(static_cast<std::uint8_t>(Opcode::kFooter)).number(std::uint64_t{20});
  head.number(summary_start).number(summary_offset_start);
  return Writer().raw(head.bytes()).number(crc32(head.bytes(), crc32(summary))).bytes();
}

std::optional<Record> next_record(std::string_view buffer) {
  Reader reader(buffer);
  std::uint8_t opcode = 0;
  Record record;
  reader.number(opcode).view<std::uint64_t>(record.content);
  if (!reader.ok()) return std::nullopt;
  record.opcode = static_cast<Opcode>(opcode);
  record.total_size = 9 + record.content.size();
  return record;
}

bool fills_its_record(Opcode opcode, std::string_view content) {
  Reader r(content);
  std::string_view skipped;
  std::uint64_t number = 0;
  if (opcode == Opcode::kHeader) {
    r.view(skipped).view(skipped);
  } else if (opcode == Opcode::kChunk) {
    std::uint32_t crc = 0;
    r.number(number).number(number).number(number).number(crc).view(skipped).view<std::uint64_t>(skipped);
  } else if (opcode == Opcode::kMessageIndex) {
    std::uint16_t channel = 0;
    r.number(channel).view(skipped);
  } else if (opcode == Opcode::kDataEnd) {
    std::uint32_t crc = 0;
    r.number(crc);
  } else {
    return true;
  }
  return r.ok() && r.at_end();
}

std::optional<Schema> decode_schema(std::string_view content) {
  Reader r(content);
  Schema s;
  r.number(s.id).text(s.name).text(s.encoding).text(s.data);
  return if_ok(r, std::move(s));
}
std::optional<Channel> decode_channel(std::string_view content) {
  Reader r(content);
  Channel c;
  std::string_view metadata;
  r.number(c.id).number(c.schema_id).text(c.topic).text(c.message_encoding).view(metadata);
  Reader inner(metadata);
  while (inner.ok() && !inner.at_end()) {
    std::string key, value;
    inner.text(key).text(value);
    c.metadata[key] = value;
  }
  if (!inner.ok()) return std::nullopt;
  return if_ok(r, std::move(c));
}
std::optional<Message> decode_message(std::string_view content) {
  Reader r(content);
  Message m;
  r.number(m.channel_id).number(m.sequence).number(m.log_time).number(m.publish_time);
  m.data = r.rest();
  return if_ok(r, m);
}
std::optional<Chunk> decode_chunk(std::string_view content) {
  Reader r(content);
  Chunk c;
  r.number(c.start_time).number(c.end_time).number(c.uncompressed_size).number(c.uncompressed_crc);
  r.text(c.compression).view<std::uint64_t>(c.records);
  return if_ok(r, std::move(c));
}
std::optional<ChunkIndex> decode_chunk_index(std::string_view content) {
  Reader r(content);
  ChunkIndex c;
  std::string_view offsets;
  r.number(c.start_time).number(c.end_time).number(c.chunk_offset).number(c.chunk_length).view(offsets);
  r.number(c.message_index_length).text(c.compression).number(c.compressed_size).number(c.uncompressed_size);
  Reader inner(offsets);
  while (inner.ok() && !inner.at_end()) {
    std::uint16_t channel = 0;
    std::uint64_t offset = 0;
    inner.number(channel).number(offset);
    c.message_index_offsets[channel] = offset;
  }
  if (!inner.ok()) return std::nullopt;
  return if_ok(r, std::move(c));
}
std::optional<Attachment> decode_attachment(std::string_view content) {
  Reader r(content);
  Attachment a;
  std::uint32_t crc = 0;
  r.number(a.log_time)
      .number(a.create_time)
      .text(a.name)
      .text(a.media_type)
      .view<std::uint64_t>(a.data)
      .number(crc);
  if (!r.ok() || (crc != 0 && crc != crc32(content.substr(0, content.size() - 4)))) return std::nullopt;
  return a;
}
std::optional<AttachmentHead> decode_attachment_head(std::string_view content) {
  Reader r(content);
  AttachmentHead a;
  r.number(a.index.log_time).number(a.index.create_time).text(a.index.name).text(a.index.media_type);
  r.number(a.data_size);
  a.index.data_size = a.data_size;
  a.head_size = content.size() - r.left();
  return if_ok(r, std::move(a));
}
std::optional<Statistics> decode_statistics(std::string_view content) {
  Reader r(content);
  Statistics s;
  std::string_view counts;
  r.number(s.message_count).number(s.schema_count).number(s.channel_count).number(s.attachment_count);
  r.number(s.metadata_count).number(s.chunk_count).number(s.start_time).number(s.end_time).view(counts);
  Reader inner(counts);
  while (inner.ok() && !inner.at_end()) {
    std::uint16_t channel = 0;
    std::uint64_t count = 0;
    inner.number(channel).number(count);
    s.channel_message_counts[channel] = count;
  }
  if (!inner.ok()) return std::nullopt;
  return if_ok(r, std::move(s));
}
std::optional<std::pair<std::uint16_t, std::vector<MessageIndexEntry>>> decode_message_index(
    std::string_view content) {
  Reader r(content);
  std::pair<std::uint16_t, std::vector<MessageIndexEntry>> index;
  std::string_view entries;
  r.number(index.first).view(entries);
  Reader inner(entries);
  while (inner.ok() && !inner.at_end()) {
    MessageIndexEntry entry;
    inner.number(entry.first).number(entry.second);
    index.second.push_back(entry);
  }
  if (!inner.ok()) return std::nullopt;
  return if_ok(r, std::move(index));
}
std::optional<std::uint32_t> decode_data_end(std::string_view content) {
  Reader r(content);
  std::uint32_t crc = 0;
  r.number(crc);
  return if_ok(r, crc);
}
std::optional<AttachmentIndex> decode_attachment_index(std::string_view content) {
  Reader r(content);
  AttachmentIndex a;
  r.number(a.offset).number(a.length).number(a.log_time).number(a.create_time).number(a.data_size);
  r.text(a.name).text(a.media_type);
  return if_ok(r, std::move(a));
}
std::optional<Footer> decode_footer(std::string_view content) {
  Reader r(content);
  Footer f;
  r.number(f.summary_start).number(f.summary_offset_start).number(f.summary_crc);
  return if_ok(r, f);
}

bool known_compression(const std::string& compression) {
  return compression.empty() || compression == "lz4" || compression == "zstd";
}

void compress_into(std::string_view bytes, const std::string& compression, std::string& out) {
  GNATHION_CHECK(known_compression(compression));
  const auto room = [&](std::size_t bound) {
    if (out.size() < bound) out.resize(bound);
  };
  std::size_t size = bytes.size();
  if (compression == "zstd") {
    constexpr int kLevel = 1;
    thread_local const std::unique_ptr<ZSTD_CCtx, std::size_t (*)(ZSTD_CCtx*)> context(ZSTD_createCCtx(),
                                                                                       ZSTD_freeCCtx);
    room(ZSTD_compressBound(bytes.size()));
    size = ZSTD_compressCCtx(context.get(), out.data(), out.size(), bytes.data(), bytes.size(), kLevel);
    GNATHION_CHECK(!ZSTD_isError(size));
  } else if (compression == "lz4") {
    room(LZ4F_compressFrameBound(bytes.size(), nullptr));
    size = LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), nullptr);
    GNATHION_CHECK(!LZ4F_isError(size));
  } else {
    out.assign(bytes);
  }
  out.resize(size);
}

std::string compress(std::string_view bytes, const std::string& compression) {
  std::string out;
  compress_into(bytes, compression, out);
  return out;
}

namespace {

bool decompress_lz4(std::string_view in, std::string& out) {
  LZ4F_dctx* context = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&context, LZ4F_VERSION))) return false;
  std::size_t written = 0, read = 0;
  bool good = true;
  while (good && read < in.size()) {
    std::size_t out_room = out.size() - written, in_room = in.size() - read;
    const std::size_t hint =
        LZ4F_decompress(context, out.data() + written, &out_room, in.data() + read, &in_room, nullptr);
    good = !LZ4F_isError(hint) && (out_room > 0 || in_room > 0);
    written += out_room;
    read += in_room;
    if (hint == 0) break;
  }
  LZ4F_freeDecompressionContext(context);
  return good && written == out.size() && read == in.size();
}

}  // namespace

Result<std::string> decompress(const Chunk& chunk, const std::string& where) {
  const auto damaged = [&](const char* why) { return bad_input("cannot read recording", where, why); };
  constexpr std::uint64_t kLargest = std::uint64_t{1} << 28;
  if (chunk.uncompressed_size > kLargest) return damaged("a chunk announces more than 256 MiB");
  std::string out;
  if (chunk.compression.empty()) {
    out.assign(chunk.records);
  } else if (chunk.compression == "zstd") {
    if (ZSTD_getFrameContentSize(chunk.records.data(), chunk.records.size()) != chunk.uncompressed_size)
      return damaged("a chunk's size does not match its header");
    out.resize(static_cast<std::size_t>(chunk.uncompressed_size));
    const std::size_t n = ZSTD_decompress(out.data(), out.size(), chunk.records.data(), chunk.records.size());
    if (ZSTD_isError(n) || n != out.size()) return damaged("a chunk's compressed data is damaged");
  } else if (chunk.compression == "lz4") {
    out.resize(static_cast<std::size_t>(chunk.uncompressed_size));
    if (!decompress_lz4(chunk.records, out)) return damaged("a chunk's compressed data is damaged");
  } else {
    return damaged("a chunk has an unknown compression");
  }
  if (out.size() != chunk.uncompressed_size) return damaged("a chunk's size does not match its header");
  if (chunk.uncompressed_crc != 0 && crc32(out) != chunk.uncompressed_crc)
    return damaged("a chunk's CRC does not match");
  return out;
}

}  // namespace gnathion::mcap
