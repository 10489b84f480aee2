#include "acquisition/mcap_writer.h"

#include <fcntl.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <set>

#include "core/check.h"

namespace gnathion {

struct McapWriter::State {
  std::string path;
  Options options;
  int fd = -1;
  std::uint64_t offset = 0;
  std::uint32_t data_crc = 0;
  std::vector<mcap::Schema> schemas;
  std::vector<mcap::Channel> channels;
  std::vector<mcap::ChunkIndex> chunks;
  std::vector<mcap::AttachmentIndex> attachments;
  mcap::Statistics statistics;
  // The open chunk.
  std::string records;
  std::uint64_t chunk_start = 0, chunk_end = 0;
  std::map<std::uint16_t, std::vector<mcap::MessageIndexEntry>> index;
};

namespace {

/// The message's file and all that it imports, dependencies first: what readers need to decode it.
std::string file_descriptor_set(const google::protobuf::Descriptor& type) {
  google::protobuf::FileDescriptorSet set;
  std::set<std::string> seen;
  const std::function<void(const google::protobuf::FileDescriptor*)> add =
      [&](const google::protobuf::FileDescriptor* file) {
        if (!seen.insert(file->name()).second) return;
        for (int i = 0; i < file->dependency_count(); ++i) add(file->dependency(i));
        file->CopyTo(set.add_file());
      };
  add(type.file());
  return set.SerializeAsString();
}

}  // namespace

McapWriter::McapWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
McapWriter::~McapWriter() {
  if (state_->fd >= 0) ::close(state_->fd);
}

Result<std::unique_ptr<McapWriter>> McapWriter::create(const std::filesystem::path& path, Options options) {
  auto state = std::make_unique<State>();
  state->path = path.string();
  state->options = std::move(options);
  state->fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (state->fd < 0)
    return fail(ErrorCode::kInternal, "cannot write recording", path.string(), std::strerror(errno));
  std::unique_ptr<McapWriter> writer(new McapWriter(std::move(state)));
  GNATHION_CHECK_OK(writer->append(std::string(mcap::kMagic) + mcap::encode_header("", "gnathion")));
  return writer;
}

Status McapWriter::append(std::string_view bytes) {
  State& s = *state_;
  s.offset += bytes.size();
  s.data_crc = mcap::crc32(bytes, s.data_crc);
  while (!bytes.empty()) {
    const ssize_t n = ::write(s.fd, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return fail(ErrorCode::kInternal, "cannot write recording", s.path, std::strerror(errno));
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
  return {};
}

std::uint16_t McapWriter::add_channel(const std::string& topic, const google::protobuf::Descriptor& type) {
  State& s = *state_;
  auto schema = std::find_if(s.schemas.begin(), s.schemas.end(),
                             [&](const mcap::Schema& x) { return x.name == type.full_name(); });
  if (schema == s.schemas.end()) {
    s.schemas.push_back({static_cast<std::uint16_t>(s.schemas.size() + 1), type.full_name(), "protobuf",
                         file_descriptor_set(type)});
    schema = s.schemas.end() - 1;
    s.records += mcap::encode(*schema);
  }
  mcap::Channel channel;
  channel.id = static_cast<std::uint16_t>(s.channels.size());
  channel.schema_id = schema->id;
  channel.topic = topic;
  channel.message_encoding = "protobuf";
  s.channels.push_back(channel);
  s.records += mcap::encode(channel);
  return channel.id;
}

Status McapWriter::write(std::uint16_t channel, std::uint32_t sequence, std::uint64_t log_time,
                         std::uint64_t publish_time, std::string_view data) {
  State& s = *state_;
  GNATHION_CHECK(channel < s.channels.size() && s.fd >= 0);
  if (!s.index.empty() && (s.records.size() + data.size() > s.options.max_chunk_bytes ||
                           log_time > s.chunk_start + s.options.max_chunk_ns)) {
    GNATHION_CHECK_OK(flush_chunk());
  }
  const bool first = s.index.empty();
  s.chunk_start = first ? log_time : std::min(s.chunk_start, log_time);
  s.chunk_end = first ? log_time : std::max(s.chunk_end, log_time);
  s.index[channel].emplace_back(log_time, s.records.size());
  s.records += mcap::encode(mcap::Message{channel, sequence, log_time, publish_time, data});
  const bool first_of_all = s.statistics.message_count == 0;
  s.statistics.start_time = first_of_all ? log_time : std::min(s.statistics.start_time, log_time);
  s.statistics.end_time = first_of_all ? log_time : std::max(s.statistics.end_time, log_time);
  ++s.statistics.message_count;
  ++s.statistics.channel_message_counts[channel];
  return {};
}

Status McapWriter::flush_chunk() {
  State& s = *state_;
  if (s.records.empty()) return {};
  const std::string packed = mcap::compress(s.records, s.options.compression);
  mcap::Chunk chunk{s.chunk_start,          s.chunk_end,           s.records.size(),
                    mcap::crc32(s.records), s.options.compression, packed};
  const std::string bytes = mcap::encode(chunk);
  mcap::ChunkIndex entry{s.chunk_start,         s.chunk_end,   s.offset,        bytes.size(), {}, 0,
                         s.options.compression, packed.size(), s.records.size()};
  std::string index_records;
  for (auto& [channel, entries] : s.index) {
    std::stable_sort(entries.begin(), entries.end(), [](auto& a, auto& b) { return a.first < b.first; });
    entry.message_index_offsets[channel] = s.offset + bytes.size() + index_records.size();
    index_records += mcap::encode_message_index(channel, entries);
  }
  entry.message_index_length = index_records.size();
  GNATHION_CHECK_OK(append(bytes + index_records));
  s.chunks.push_back(std::move(entry));
  s.records.clear();
  s.index.clear();
  return {};
}

Status McapWriter::attach(const std::string& name, const std::string& media_type, std::string_view data) {
  State& s = *state_;
  GNATHION_CHECK_OK(flush_chunk());
  mcap::Attachment attachment{s.statistics.end_time, s.statistics.end_time, name, media_type, data};
  const std::string bytes = mcap::encode(attachment);
  s.attachments.push_back(
      {s.offset, bytes.size(), attachment.log_time, attachment.create_time, data.size(), name, media_type});
  return append(bytes);
}

std::string McapWriter::summary(std::string* offsets, std::uint64_t start) const {
  const State& s = *state_;
  std::string bytes;
  const auto group = [&](mcap::Opcode opcode, const auto& items) {
    const std::size_t begin = bytes.size();
    for (const auto& item : items) bytes += mcap::encode(item);
    if (bytes.size() > begin)
      *offsets += mcap::encode_summary_offset(opcode, start + begin, bytes.size() - begin);
  };
  mcap::Statistics statistics = s.statistics;
  statistics.schema_count = static_cast<std::uint16_t>(s.schemas.size());
  statistics.channel_count = static_cast<std::uint32_t>(s.channels.size());
  statistics.attachment_count = static_cast<std::uint32_t>(s.attachments.size());
  statistics.chunk_count = static_cast<std::uint32_t>(s.chunks.size());
  group(mcap::Opcode::kSchema, s.schemas);
  group(mcap::Opcode::kChannel, s.channels);
  group(mcap::Opcode::kStatistics, std::vector<mcap::Statistics>{statistics});
  group(mcap::Opcode::kChunkIndex, s.chunks);
  group(mcap::Opcode::kAttachmentIndex, s.attachments);
  return bytes;
}

Status McapWriter::finish() {
  State& s = *state_;
  GNATHION_CHECK(s.fd >= 0);
  GNATHION_CHECK_OK(flush_chunk());
  GNATHION_CHECK_OK(append(mcap::encode_data_end(s.data_crc)));
  const std::uint64_t start = s.offset;
  std::string offsets;
  std::string tail = summary(&offsets, start);
  const std::uint64_t offsets_start = start + tail.size();
  tail += offsets;
  tail += mcap::encode_footer(start, offsets_start, tail);
  GNATHION_CHECK_OK(append(tail + std::string(mcap::kMagic)));
  const bool synced = ::fsync(s.fd) == 0;
  const bool closed = ::close(s.fd) == 0;
  s.fd = -1;
  if (!synced || !closed)
    return fail(ErrorCode::kInternal, "cannot write recording", s.path, std::strerror(errno));
  return {};
}

}  // namespace gnathion
