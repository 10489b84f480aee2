#include "acquisition/mcap_writer.h"

#include <fcntl.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <functional>
#include <set>

#include "acquisition/disk_reserve.h"
#include "core/check.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot write recording";

/// Where a schema's or a channel's record stands. Readers need it before the first message.
enum class Place : std::uint8_t { kNowhere, kOpenChunk, kFile };

template <class T>
struct Placed {
  T record;
  Place place = Place::kNowhere;
  bool used = false;
};

}  // namespace

struct McapWriter::State {
  std::string path;
  Options options;
  int fd = -1;
  std::atomic<std::uint64_t> offset{0}, synced{0};
  std::uint32_t data_crc = 0;
  bool data_crc_known = true;
  std::optional<Error> error;
  bool out_of_room = false;  ///< the error
  std::unique_ptr<DiskReserve> reserve;
  std::vector<Placed<mcap::Schema>> schemas;
  std::vector<Placed<mcap::Channel>> channels;
  std::string chunk_index;                 ///< encoded entries, one a chunk
  std::vector<std::uint64_t> entry_begin;  ///< where each starts in chunk_index
  std::vector<mcap::AttachmentIndex> attachments;
  mcap::Statistics statistics;  ///< of what is in the file
  // The open chunk.
  std::string records, packed;
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

/// Writes everything at `offset`, or tells why not.
bool write_at(int fd, std::uint64_t offset, std::array<iovec, 3> parts) {
  std::size_t first = 0;
  while (first < parts.size()) {
    if (parts[first].iov_len == 0) {
      ++first;
      continue;
    }
    const ssize_t n =
        ::pwritev(fd, &parts[first], static_cast<int>(parts.size() - first), static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n == 0) errno = ENOSPC;
    if (n <= 0) return false;
    offset += static_cast<std::uint64_t>(n);
    for (auto left = static_cast<std::size_t>(n); left > 0;) {
      const std::size_t step = std::min(left, parts[first].iov_len);
      parts[first].iov_base = static_cast<char*>(parts[first].iov_base) + step;
      parts[first].iov_len -= step;
      left -= step;
      if (parts[first].iov_len == 0 && left > 0) ++first;
    }
  }
  return true;
}

iovec as_iovec(std::string_view s) {
  return {const_cast<char*>(s.data()), s.size()};
}

/// The file's name survives a power loss too.
void sync_folder(const std::filesystem::path& file) {
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  ::fsync(fd);
  ::close(fd);
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
  if (!mcap::known_compression(state->options.compression))
    return fail(ErrorCode::kUsage, kWhat, path.string(),
                "unknown compression '" + state->options.compression + "'; known are zstd, lz4 and none");
  state->fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (state->fd < 0) return fail(ErrorCode::kInternal, kWhat, path.string(), std::strerror(errno));
  sync_folder(path);
  if (state->options.reserve_space) state->reserve = std::make_unique<DiskReserve>(path);
  std::unique_ptr<McapWriter> writer(new McapWriter(std::move(state)));
  GNATHION_CHECK_OK(writer->keep_reserve());
  GNATHION_CHECK_OK(writer->append(mcap::kMagic, mcap::encode_header("", "gnathion")));
  return writer;
}

Status McapWriter::failed(int why_errno) {
  State& s = *state_;
  const char* why = std::strerror(why_errno);
  s.out_of_room = why_errno == ENOSPC || why_errno == EFBIG || why_errno == EDQUOT;
  s.error = Error{ErrorCode::kInternal, kWhat, s.path, why};
  return tl::unexpected<Error>(*s.error);
}

/// All of it or, after an error, nothing: the file then ends where it did before.
Status McapWriter::append(std::string_view a, std::string_view b, std::string_view c) {
  State& s = *state_;
  if (!write_at(s.fd, s.offset, {as_iovec(a), as_iovec(b), as_iovec(c)})) {
    const int why = errno;
    if (::ftruncate(s.fd, static_cast<off_t>(s.offset.load())) != 0) return failed(errno);
    return failed(why);
  }
  for (const std::string_view part : {a, b, c}) s.data_crc = mcap::crc32(part, s.data_crc);
  s.offset += a.size() + b.size() + c.size();
  return {};
}

/// Room for the index as it stands, twice, and for a last chunk.
Status McapWriter::keep_reserve() {
  State& s = *state_;
  if (!s.reserve || s.reserve->grow_to((std::uint64_t{1} << 20) + 2 * s.chunk_index.size())) return {};
  return failed(errno);
}

std::uint16_t McapWriter::add_channel(const std::string& topic, const google::protobuf::Descriptor& type,
                                      std::map<std::string, std::string> metadata) {
  mcap::Channel channel;
  channel.topic = topic;
  channel.message_encoding = "protobuf";
  channel.metadata = std::move(metadata);
  return add_channel(channel, {1, type.full_name(), "protobuf", file_descriptor_set(type)});
}

std::uint16_t McapWriter::add_channel(const mcap::Channel& given, const mcap::Schema& schema) {
  State& s = *state_;
  GNATHION_CHECK(s.channels.size() < 0xFFFF);
  mcap::Channel channel = given;
  channel.id = static_cast<std::uint16_t>(s.channels.size());
  channel.schema_id = 0;
  if (schema.id != 0) {
    auto known = std::find_if(s.schemas.begin(), s.schemas.end(), [&](const Placed<mcap::Schema>& x) {
      return x.record.name == schema.name && x.record.encoding == schema.encoding &&
             x.record.data == schema.data;
    });
    if (known == s.schemas.end()) {
      s.schemas.push_back({schema});
      known = s.schemas.end() - 1;
      known->record.id = static_cast<std::uint16_t>(s.schemas.size());
    }
    channel.schema_id = known->record.id;
  }
  s.channels.push_back({channel});
  return channel.id;
}

/// The channel's record and its schema's, unless they are there already.
void McapWriter::put_channel(std::uint16_t id) {
  State& s = *state_;
  const auto put = [&](auto& placed) {
    if (placed.place == Place::kNowhere) {
      s.records += mcap::encode(placed.record);
      placed.place = Place::kOpenChunk;
    }
  };
  const std::uint16_t schema = s.channels[id].record.schema_id;
  if (schema != 0) put(s.schemas[schema - 1u]);
  put(s.channels[id]);
}

Status McapWriter::write(std::uint16_t channel, std::uint32_t sequence, std::uint64_t log_time,
                         std::uint64_t publish_time, std::string_view head, std::string_view body) {
  State& s = *state_;
  GNATHION_CHECK(channel < s.channels.size() && s.fd >= 0);
  if (s.error) return tl::unexpected<Error>(*s.error);
  if (!s.index.empty()) {
    const std::uint64_t begin = std::min(s.chunk_start, log_time), end = std::max(s.chunk_end, log_time);
    if (s.records.size() + head.size() + body.size() > s.options.max_chunk_bytes ||
        end - begin > s.options.max_chunk_ns)
      GNATHION_CHECK_OK(flush());
  }
  const bool first = s.index.empty();
  s.chunk_start = first ? log_time : std::min(s.chunk_start, log_time);
  s.chunk_end = first ? log_time : std::max(s.chunk_end, log_time);
  put_channel(channel);
  s.index[channel].emplace_back(log_time, s.records.size());
  mcap::append_message(s.records, {channel, sequence, log_time, publish_time, head}, body);
  return {};
}

void McapWriter::discard_open_chunk() {
  State& s = *state_;
  s.records.clear();
  s.index.clear();
  for (auto& x : s.schemas)
    if (x.place == Place::kOpenChunk) x.place = Place::kNowhere;
  for (auto& x : s.channels)
    if (x.place == Place::kOpenChunk) x.place = Place::kNowhere;
}

Status McapWriter::flush() {
  State& s = *state_;
  if (s.error) return tl::unexpected<Error>(*s.error);
  if (s.index.empty()) return {};
  mcap::compress_into(s.records, s.options.compression, s.packed);
  const mcap::Chunk chunk{s.chunk_start,          s.chunk_end,           s.records.size(),
                          mcap::crc32(s.records), s.options.compression, {}};
  const std::string head = mcap::encode_chunk_head(chunk, s.packed.size());
  const std::uint64_t length = head.size() + s.packed.size();
  mcap::ChunkIndex entry{s.chunk_start,         s.chunk_end,     s.offset,        length, {}, 0,
                         s.options.compression, s.packed.size(), s.records.size()};
  std::string index_records;
  for (auto& [channel, entries] : s.index) {
    std::stable_sort(entries.begin(), entries.end(), [](auto& a, auto& b) { return a.first < b.first; });
    entry.message_index_offsets[channel] = s.offset + length + index_records.size();
    index_records += mcap::encode_message_index(channel, entries);
  }
  entry.message_index_length = index_records.size();
  Status written = append(head, s.packed, index_records);
  if (!written) {
    discard_open_chunk();
    return written;
  }
  mcap::Statistics& t = s.statistics;
  const bool first = t.message_count == 0;
  t.start_time = first ? s.chunk_start : std::min(t.start_time, s.chunk_start);
  t.end_time = first ? s.chunk_end : std::max(t.end_time, s.chunk_end);
  for (const auto& [channel, entries] : s.index) {
    t.message_count += entries.size();
    t.channel_message_counts[channel] += entries.size();
  }
  s.entry_begin.push_back(s.chunk_index.size());
  s.chunk_index += mcap::encode(entry);
  for (auto& x : s.schemas)
    if (x.place == Place::kOpenChunk) x.place = Place::kFile, x.used = true;
  for (auto& x : s.channels)
    if (x.place == Place::kOpenChunk) x.place = Place::kFile, x.used = true;
  s.records.clear();
  s.index.clear();
  return keep_reserve();
}

Status McapWriter::attach(const std::string& name, const std::string& media_type, std::string_view data) {
  State& s = *state_;
  GNATHION_CHECK_OK(flush());
  mcap::Attachment attachment{s.statistics.end_time, s.statistics.end_time, name, media_type, data};
  const std::string bytes = mcap::encode(attachment);
  const std::uint64_t offset = s.offset;
  GNATHION_CHECK_OK(append(bytes));
  s.attachments.push_back(
      {offset, bytes.size(), attachment.log_time, attachment.create_time, data.size(), name, media_type});
  return {};
}

Status McapWriter::sync() {
  State& s = *state_;
  const std::uint64_t upto = s.offset;
  if (::fdatasync(s.fd) != 0)
    return fail(ErrorCode::kInternal, "cannot make recording durable", s.path, std::strerror(errno));
  s.synced = upto;
  return {};
}

std::string McapWriter::summary(std::string* offsets, std::uint64_t start) const {
  const State& s = *state_;
  std::string bytes;
  mcap::Statistics statistics = s.statistics;
  const auto group = [&](mcap::Opcode opcode, const auto& add_items) {
    const std::size_t begin = bytes.size();
    add_items();
    if (bytes.size() > begin)
      *offsets += mcap::encode_summary_offset(opcode, start + begin, bytes.size() - begin);
  };
  group(mcap::Opcode::kSchema, [&] {
    for (const auto& x : s.schemas)
      if (x.used) bytes += mcap::encode(x.record), ++statistics.schema_count;
  });
  group(mcap::Opcode::kChannel, [&] {
    for (const auto& x : s.channels)
      if (x.used) bytes += mcap::encode(x.record), ++statistics.channel_count;
  });
  statistics.attachment_count = static_cast<std::uint32_t>(s.attachments.size());
  statistics.chunk_count = static_cast<std::uint32_t>(s.entry_begin.size());
  group(mcap::Opcode::kStatistics, [&] { bytes += mcap::encode(statistics); });
  group(mcap::Opcode::kChunkIndex, [&] { bytes += s.chunk_index; });
  group(mcap::Opcode::kAttachmentIndex, [&] {
    for (const auto& x : s.attachments) bytes += mcap::encode(x);
  });
  return bytes;
}

Status McapWriter::finish() {
  State& s = *state_;
  GNATHION_CHECK(s.fd >= 0);
  GNATHION_CHECK_OK(flush());
  const std::string data_end = mcap::encode_data_end(s.data_crc_known ? s.data_crc : 0);
  const std::uint64_t start = s.offset + data_end.size();
  std::string offsets;
  std::string tail = summary(&offsets, start);
  const std::uint64_t offsets_start = start + tail.size();
  tail += offsets;
  tail += mcap::encode_footer(start, offsets_start, tail);
  s.reserve.reset();
  GNATHION_CHECK_OK(append(data_end, tail, mcap::kMagic));
  const bool synced = ::fsync(s.fd) == 0;
  const bool closed = ::close(s.fd) == 0;
  s.fd = -1;
  if (!synced || !closed) return failed(errno);
  s.synced = s.offset.load();
  return {};
}

std::uint64_t McapWriter::file_bytes() const {
  return state_->offset;
}
std::uint64_t McapWriter::synced_bytes() const {
  return state_->synced;
}
std::uint64_t McapWriter::chunks() const {
  return state_->entry_begin.size();
}
std::uint64_t McapWriter::index_bytes() const {
  return state_->chunk_index.size() + 8 * state_->entry_begin.size();
}
const std::optional<Error>& McapWriter::error() const {
  return state_->error;
}
bool McapWriter::is_out_of_room() const {
  return state_->error && state_->out_of_room;
}
bool McapWriter::is_open() const {
  return state_->fd >= 0;
}

void McapWriter::use_reserve() {
  state_->error.reset();
  state_->reserve.reset();
}

std::optional<std::vector<McapWriter::Dropped>> McapWriter::drop_last_chunk() {
  State& s = *state_;
  if (s.entry_begin.empty()) return std::nullopt;
  discard_open_chunk();
  const std::string_view last = std::string_view(s.chunk_index).substr(s.entry_begin.back());
  const mcap::ChunkIndex entry = *mcap::decode_chunk_index(mcap::next_record(last)->content);
  std::vector<Dropped> dropped;
  std::string bytes(static_cast<std::size_t>(entry.chunk_length), '\0');
  const ssize_t n = ::pread(s.fd, bytes.data(), bytes.size(), static_cast<off_t>(entry.chunk_offset));
  const auto record = n == static_cast<ssize_t>(bytes.size()) ? mcap::next_record(bytes) : std::nullopt;
  const auto chunk = record ? mcap::decode_chunk(record->content) : std::nullopt;
  const auto records = chunk ? mcap::decompress(*chunk, s.path) : Result<std::string>();
  if (!records || records->empty()) return std::nullopt;  // what cannot be told is not cut off
  std::string_view rest = *records;
  while (const auto r = mcap::next_record(rest)) {
    if (const auto m = mcap::decode_message(r->content); m && r->opcode == mcap::Opcode::kMessage)
      dropped.push_back({m->channel_id, m->sequence, m->log_time, m->publish_time});
    rest.remove_prefix(r->total_size);
  }
  if (::ftruncate(s.fd, static_cast<off_t>(entry.chunk_offset)) != 0) return std::nullopt;
  s.offset = entry.chunk_offset;
  s.data_crc_known = false;
  s.chunk_index.resize(s.entry_begin.back());
  s.entry_begin.pop_back();
  while (!s.attachments.empty() && s.attachments.back().offset >= entry.chunk_offset)
    s.attachments.pop_back();
  for (const Dropped& d : dropped) {
    --s.statistics.message_count;
    if (--s.statistics.channel_message_counts[d.channel] == 0)
      s.statistics.channel_message_counts.erase(d.channel);
  }
  // The records of channels may have stood in that chunk; standing twice does no harm.
  for (auto& x : s.schemas) x.place = Place::kNowhere;
  for (auto& x : s.channels) x.place = Place::kNowhere;
  return dropped;
}

}  // namespace gnathion
