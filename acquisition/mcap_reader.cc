#include "acquisition/mcap_reader.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace gnathion {
namespace {
constexpr const char* kWhat = "cannot read recording";
constexpr std::uint64_t kLargestRecord = std::uint64_t{1} << 30;
}  // namespace

McapReader::~McapReader() {
  if (fd_ >= 0) ::close(fd_);
}

Result<std::unique_ptr<McapReader>> McapReader::open(const std::filesystem::path& path, Ending ending) {
  std::unique_ptr<McapReader> r(new McapReader);
  r->path_ = path.string();
  r->ending_ = ending;
  r->fd_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (r->fd_ < 0) return bad_input(kWhat, r->path_, std::strerror(errno));
  struct stat facts {};
  if (::fstat(r->fd_, &facts) != 0) return bad_input(kWhat, r->path_, std::strerror(errno));
  if (S_ISDIR(facts.st_mode)) return bad_input(kWhat, r->path_, "is a directory");
  if (!S_ISREG(facts.st_mode)) return bad_input(kWhat, r->path_, "is not a file");
  r->size_ = static_cast<std::uint64_t>(facts.st_size);
  if (r->size_ == 0) return bad_input(kWhat, r->path_, "empty file");
  std::string magic;
  if (!r->read_at(0, mcap::kMagic.size(), magic) || magic != mcap::kMagic)
    return bad_input(kWhat, r->path_, "not an MCAP file");
  r->position_ = magic.size();
  r->running_crc_ = mcap::crc32(magic);
  const bool ended = r->size_ >= 2 * magic.size() &&
                     r->read_at(r->size_ - magic.size(), magic.size(), magic) && magic == mcap::kMagic;
  if (ending == Ending::kMustBeWhole && !ended)
    return bad_input(
        kWhat, r->path_,
        fmt::format("cut off after {} bytes, before its end was written; 'gnathion recording recover' "
                    "saves what is whole",
                    r->size_));
  if (ended) r->load_summary();
  return r;
}

bool McapReader::read_at(std::uint64_t offset, std::uint64_t n, std::string& out) const {
  if (offset > size_ || n > size_ - offset) return false;
  out.resize(static_cast<std::size_t>(n));
  for (std::size_t done = 0; done < out.size();) {
    const ssize_t got = ::pread(fd_, out.data() + done, out.size() - done, static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return false;
    done += static_cast<std::size_t>(got);
  }
  return true;
}

Result<bool> McapReader::damaged(const std::string& why, bool can_go_on) {
  const std::uint64_t begin = record_start_;
  std::optional<std::uint64_t> end = can_go_on ? std::optional(position_) : std::nullopt;
  if (ending_ == Ending::kAsFarAsItGoes && !end) {
    end = find_chunk_behind(begin);
    if (end) position_ = *end;
  }
  if (!damage_) damage_ = Damage{begin, end.value_or(size_), why};
  if (ending_ == Ending::kMustBeWhole || !end) over_ = true;
  if (ending_ == Ending::kAsFarAsItGoes) return false;
  return bad_input(kWhat, path_, fmt::format("damaged at byte {}: {}", begin, why));
}

/// Contents that only checking needs are passed over otherwise; attachments always, being read in pieces.
bool McapReader::wants_content(mcap::Opcode opcode) const {
  switch (opcode) {
    case mcap::Opcode::kSchema:
    case mcap::Opcode::kChannel:
    case mcap::Opcode::kMessage:
    case mcap::Opcode::kChunk:
    case mcap::Opcode::kDataEnd:
      return true;
    case mcap::Opcode::kAttachment:
      return false;
    default:
      return ending_ == Ending::kAsFarAsItGoes;
  }
}

McapReader::Step McapReader::read_record(std::string& content, mcap::Opcode& opcode) {
  constexpr std::uint64_t kHead = 9;  // opcode, length
  record_start_ = position_;
  if (position_ == size_) return Step::kEnd;
  std::string head;
  if (!read_at(position_, kHead, head)) return Step::kDamaged;
  std::uint64_t length = 0;
  for (std::size_t i = 0; i < 8; ++i)
    length |= static_cast<std::uint64_t>(static_cast<unsigned char>(head[i + 1])) << (8 * i);
  opcode = static_cast<mcap::Opcode>(head[0]);
  const bool whole = wants_content(opcode);
  if (length > size_ - position_ - kHead || (whole && length > kLargestRecord)) return Step::kDamaged;
  content.clear();
  if (whole && !read_at(position_ + kHead, length, content)) return Step::kDamaged;
  position_ += kHead + length;
  if (ending_ == Ending::kAsFarAsItGoes && opcode != mcap::Opcode::kDataEnd)
    running_crc_ = whole ? mcap::crc32(content, mcap::crc32(head, running_crc_))
                         : crc_of(record_start_, position_, running_crc_);
  return Step::kRecord;
}

Result<bool> McapReader::take_chunk(std::string_view content) {
  const auto chunk = mcap::decode_chunk(content);
  if (!chunk) return damaged("a chunk's lengths do not fit", true);
  if (ending_ == Ending::kMustBeWhole && chunk->end_time < from_) return false;
  auto records = mcap::decompress(*chunk, path_);
  if (!records) return damaged(records.error().why, true);
  chunk_ = std::move(*records);
  if (ending_ == Ending::kAsFarAsItGoes) {
    const std::string why = message_index_of_chunk(*chunk);
    if (!why.empty()) return damaged(why, true);
    ++chunk_facts_.count;
    chunk_facts_.largest_bytes = std::max<std::uint64_t>(chunk_facts_.largest_bytes, chunk_.size());
    chunk_facts_.longest_ns = std::max(chunk_facts_.longest_ns, chunk->end_time - chunk->start_time);
  }
  unread_ = chunk_;
  return true;
}

Result<bool> McapReader::take_data_end(std::string_view content) {
  over_ = true;
  if (ending_ == Ending::kMustBeWhole || damage_) return false;
  const auto crc = mcap::decode_data_end(content);
  if (!crc) return damaged("the end of the data is damaged", true);
  if (*crc != 0 && *crc != running_crc_) {
    record_start_ = 0;
    return damaged("the CRC of all data does not match, though each chunk's does", true);
  }
  return false;
}

/// False: nothing for the caller in this record, or the end of the data.
Result<bool> McapReader::take_record(mcap::Opcode opcode, std::string_view content) {
  if (ending_ == Ending::kAsFarAsItGoes && !mcap::fills_its_record(opcode, content))
    return damaged("a record's lengths do not fit", true);
  switch (opcode) {
    case mcap::Opcode::kSchema: {
      auto schema = mcap::decode_schema(content);
      if (!schema) return damaged("a schema's lengths do not fit", true);
      schemas_.emplace(schema->id, std::move(*schema));
      return false;
    }
    case mcap::Opcode::kChannel: {
      auto channel = mcap::decode_channel(content);
      if (!channel) return damaged("a channel's lengths do not fit", true);
      // A repeated record must not move the channel that a caller may still look at.
      channels_.emplace(channel->id, std::move(*channel));
      return false;
    }
    case mcap::Opcode::kMessage:
      loose_ = mcap::decode_message(content);
      if (!loose_ || !channels_.count(loose_->channel_id)) {
        loose_.reset();
        return damaged("a message has no channel", true);
      }
      if (loose_->log_time < from_) {
        loose_.reset();
        return false;
      }
      return true;
    case mcap::Opcode::kChunk:
      return take_chunk(content);
    case mcap::Opcode::kAttachment:
      return take_attachment();
    case mcap::Opcode::kDataEnd:
      return take_data_end(content);
    case mcap::Opcode::kMessageIndex: {
      if (ending_ == Ending::kMustBeWhole) return false;
      const std::string why = message_index_damage(content);
      return why.empty() ? Result<bool>(false) : damaged(why, true);
    }
    case mcap::Opcode::kHeader:
    case mcap::Opcode::kMetadata:
      return false;
    default: {
      // Opcodes from 0x80 on are other programs' own; the lower ones stand for nothing in a data section.
      const bool own = static_cast<std::uint8_t>(opcode) >= 0x80;
      return own || ending_ == Ending::kMustBeWhole ? Result<bool>(false)
                                                    : damaged("a record of an unknown kind", true);
    }
  }
}

Result<std::optional<McapMessage>> McapReader::next() {
  while (true) {
    loose_.reset();
    mcap::Opcode opcode{};
    std::string_view content;
    if (!unread_.empty()) {
      const auto record = mcap::next_record(unread_);
      if (!record) {
        unread_ = {};
        GNATHION_CHECK_OK(damaged("a record inside a chunk is cut off", true));
        continue;
      }
      unread_.remove_prefix(record->total_size);
      opcode = record->opcode;
      content = record->content;
      // A chunk holds schemas, channels and messages; a chunk in a chunk would tear away what is being read.
      if (opcode != mcap::Opcode::kSchema && opcode != mcap::Opcode::kChannel &&
          opcode != mcap::Opcode::kMessage)
        continue;
    } else {
      if (over_) return std::optional<McapMessage>();
      const Step step = read_record(content_, opcode);
      if (step != Step::kRecord) {
        GNATHION_CHECK_OK(
            damaged(step == Step::kEnd ? "ends without its end record" : "a record is cut off", false));
        continue;
      }
      content = content_;
    }
    GNATHION_CHECK_OK(take_record(opcode, content));
    if (!loose_) continue;
    const mcap::Channel& channel = channels_.at(loose_->channel_id);
    const auto schema = schemas_.find(channel.schema_id);
    return std::optional<McapMessage>(
        McapMessage{&channel, schema == schemas_.end() ? nullptr : &schema->second, *loose_});
  }
}

}  // namespace gnathion
