// The MCAP container, version 0: records to bytes and back. Pure: no files, no clocks.
// Source: the mcap repository, website/docs/spec/index.md. All integers little-endian.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace gnathion::mcap {

constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);

enum class Opcode : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kAttachment = 0x09,
  kAttachmentIndex = 0x0A,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F,
};

struct Schema {
  std::uint16_t id = 0;
  std::string name, encoding, data;
};
struct Channel {
  std::uint16_t id = 0, schema_id = 0;
  std::string topic, message_encoding;
  std::map<std::string, std::string> metadata;
};
struct Message {
  std::uint16_t channel_id = 0;
  std::uint32_t sequence = 0;      ///< the device's counter
  std::uint64_t log_time = 0;      ///< arrival, ns
  std::uint64_t publish_time = 0;  ///< capture, ns
  std::string_view data;           ///< into the buffer that was parsed
};
struct Chunk {
  std::uint64_t start_time = 0, end_time = 0, uncompressed_size = 0;
  std::uint32_t uncompressed_crc = 0;
  std::string compression;
  std::string_view records;  ///< compressed; into the buffer that was parsed
};
struct ChunkIndex {
  std::uint64_t start_time = 0, end_time = 0, chunk_offset = 0, chunk_length = 0;
  std::map<std::uint16_t, std::uint64_t> message_index_offsets;
  std::uint64_t message_index_length = 0;
  std::string compression;
  std::uint64_t compressed_size = 0, uncompressed_size = 0;
};
struct AttachmentIndex {
  std::uint64_t offset = 0, length = 0, log_time = 0, create_time = 0, data_size = 0;
  std::string name, media_type;
};
struct Attachment {
  std::uint64_t log_time = 0, create_time = 0;
  std::string name, media_type;
  std::string_view data;
};
struct Statistics {
  std::uint64_t message_count = 0;
  std::uint16_t schema_count = 0;
  std::uint32_t channel_count = 0, attachment_count = 0, metadata_count = 0, chunk_count = 0;
  std::uint64_t start_time = 0, end_time = 0;
  std::map<std::uint16_t, std::uint64_t> channel_message_counts;
};
struct Footer {
  std::uint64_t summary_start = 0, summary_offset_start = 0;
  std::uint32_t summary_crc = 0;
};
/// Log time and offset of a message inside its uncompressed chunk.
using MessageIndexEntry = std::pair<std::uint64_t, std::uint64_t>;

/// CRC-32 of zlib, continued from `crc` (0 to start).
std::uint32_t crc32(std::string_view bytes, std::uint32_t crc = 0);

std::string encode_header(const std::string& profile, const std::string& library);
std::string encode(const Schema& s);
std::string encode(const Channel& c);
std::string encode(const Message& m);
/// Appends a message whose data stands in two parts: an image's pixels are copied only here.
void append_message(std::string& out, const Message& m, std::string_view body);
std::string encode(const Chunk& c);
/// A chunk record without its compressed records, which must follow; `compressed_size` tells how many bytes.
std::string encode_chunk_head(const Chunk& c, std::uint64_t compressed_size);
std::string encode(const ChunkIndex& c);
std::string encode(const Attachment& a);
std::string encode(const AttachmentIndex& a);
std::string encode(const Statistics& s);
std::string encode_message_index(std::uint16_t channel, const std::vector<MessageIndexEntry>& entries);
std::string encode_summary_offset(Opcode group, std::uint64_t start, std::uint64_t length);
std::string encode_data_end(std::uint32_t data_crc);
/// Everything of the footer but its CRC, then the CRC over `summary` and that.
std::string encode_footer(std::uint64_t summary_start, std::uint64_t summary_offset_start,
                          std::string_view summary);

/// One record in a buffer.
struct Record {
  Opcode opcode = Opcode::kHeader;
  std::string_view content;
  std::size_t total_size = 0;  ///< opcode, length and content
};
/// The record at the buffer's start; nothing if the buffer ends before the record does.
std::optional<Record> next_record(std::string_view buffer);

// Each refuses content that is too short or whose inner lengths lie; nothing is allocated beyond it.
/// Whether a header, chunk, message index or data end is just as long as its fields say. (Later versions of
/// the format may add fields; a damaged length looks the same.)
bool fills_its_record(Opcode opcode, std::string_view content);
std::optional<Schema> decode_schema(std::string_view content);
std::optional<Channel> decode_channel(std::string_view content);
std::optional<Message> decode_message(std::string_view content);
std::optional<Chunk> decode_chunk(std::string_view content);
std::optional<ChunkIndex> decode_chunk_index(std::string_view content);
std::optional<Attachment> decode_attachment(std::string_view content);
/// What stands before an attachment's data; offset and length are left 0.
struct AttachmentHead {
  AttachmentIndex index;
  std::uint64_t head_size = 0, data_size = 0;
};
std::optional<AttachmentHead> decode_attachment_head(std::string_view content);
std::optional<AttachmentIndex> decode_attachment_index(std::string_view content);
std::optional<Statistics> decode_statistics(std::string_view content);
std::optional<std::pair<std::uint16_t, std::vector<MessageIndexEntry>>> decode_message_index(
    std::string_view content);
std::optional<std::uint32_t> decode_data_end(std::string_view content);
std::optional<Footer> decode_footer(std::string_view content);

/// "" (none), "lz4" (frame) or "zstd" (level 1: what a core keeps up with, docs/recording.md).
bool known_compression(const std::string& compression);
std::string compress(std::string_view bytes, const std::string& compression);
/// The same into `out`, whose memory is used again.
void compress_into(std::string_view bytes, const std::string& compression, std::string& out);
/// The chunk's records, CRC checked. At most 256 MiB.
Result<std::string> decompress(const Chunk& chunk, const std::string& where);

}  // namespace gnathion::mcap
