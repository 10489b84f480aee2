#include "acquisition/mcap_reader.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>

namespace gnathion {
namespace {
constexpr const char* kWhat = "cannot read recording";
constexpr std::uint64_t kLargestRecord = std::uint64_t{1} << 30;
}  // namespace

Result<std::unique_ptr<McapReader>> McapReader::open(const std::filesystem::path& path, Ending ending) {
  std::unique_ptr<McapReader> r(new McapReader);
  r->path_ = path.string();
  r->ending_ = ending;
  std::error_code ec;
  if (std::filesystem::is_directory(path, ec)) return bad_input(kWhat, r->path_, "is a directory");
  r->file_.open(path, std::ios::binary);
  if (!r->file_) return bad_input(kWhat, r->path_, std::strerror(errno));
  r->size_ = std::filesystem::file_size(path, ec);
  if (r->size_ == 0) return bad_input(kWhat, r->path_, "empty file");
  std::string magic(mcap::kMagic.size(), '\0');
  r->file_.read(magic.data(), static_cast<std::streamsize>(magic.size()));
  if (!r->file_ || magic != mcap::kMagic) return bad_input(kWhat, r->path_, "not an MCAP file");
  r->position_ = magic.size();
  if (ending == Ending::kMustBeWhole) {
    r->file_.seekg(-static_cast<std::streamoff>(magic.size()), std::ios::end);
    r->file_.read(magic.data(), static_cast<std::streamsize>(magic.size()));
    if (r->size_ < 2 * magic.size() || magic != mcap::kMagic)
      return bad_input(
          kWhat, r->path_,
          fmt::format("cut off after {} bytes, before its end was written; 'gnathion recording recover' "
                      "saves what is whole",
                      r->size_));
    r->file_.seekg(static_cast<std::streamoff>(magic.size()));
  }
  return r;
}

Result<bool> McapReader::damaged(const std::string& why, bool can_go_on) {
  if (!damage_) damage_ = Damage{record_start_, can_go_on ? position_ : size_, why};
  if (ending_ == Ending::kMustBeWhole || !can_go_on) over_ = true;
  if (ending_ == Ending::kAsFarAsItGoes) return false;
  return bad_input(kWhat, path_, fmt::format("damaged at byte {}: {}", record_start_, why));
}

McapReader::Step McapReader::read_record(std::string& content, mcap::Opcode& opcode) {
  record_start_ = position_;
  if (position_ == size_) return Step::kEnd;
  std::string head(9, '\0');
  if (size_ - position_ < head.size()) return Step::kDamaged;
  file_.read(head.data(), 9);
  std::uint64_t length = 0;
  for (std::size_t i = 0; i < 8; ++i)
    length |= static_cast<std::uint64_t>(static_cast<unsigned char>(head[i + 1])) << (8 * i);
  if (!file_ || length > size_ - position_ - 9 || length > kLargestRecord) return Step::kDamaged;
  opcode = static_cast<mcap::Opcode>(head[0]);
  content.resize(static_cast<std::size_t>(length));
  file_.read(content.data(), static_cast<std::streamsize>(length));
  if (!file_) return Step::kDamaged;
  position_ += 9 + length;
  return Step::kRecord;
}

Result<bool> McapReader::take_chunk(std::string_view content) {
  const auto chunk = mcap::decode_chunk(content);
  if (!chunk) return damaged("a chunk's lengths do not fit", true);
  auto records = mcap::decompress(*chunk, path_);
  if (!records) return damaged(records.error().why, true);
  chunk_ = std::move(*records);
  unread_ = chunk_;
  return true;
}

/// False: nothing for the caller in this record, or the end of the data.
Result<bool> McapReader::take_record(mcap::Opcode opcode, std::string_view content) {
  switch (opcode) {
    case mcap::Opcode::kSchema: {
      auto schema = mcap::decode_schema(content);
      if (!schema) return damaged("a schema's lengths do not fit", true);
      schemas_[schema->id] = std::move(*schema);
      return false;
    }
    case mcap::Opcode::kChannel: {
      auto channel = mcap::decode_channel(content);
      if (!channel) return damaged("a channel's lengths do not fit", true);
      // A repeated record must not move the channel that a caller may still look at.
      if (!channels_.count(channel->id)) channels_[channel->id] = std::move(*channel);
      return false;
    }
    case mcap::Opcode::kMessage:
      loose_ = mcap::decode_message(content);
      if (!loose_ || !channels_.count(loose_->channel_id)) return damaged("a message has no channel", true);
      return true;
    case mcap::Opcode::kChunk:
      return take_chunk(content);
    case mcap::Opcode::kAttachment: {
      const auto attachment = mcap::decode_attachment(content);
      if (!attachment) return damaged("an attachment is damaged", true);
      attachments_[attachment->name] = std::string(attachment->data);
      return false;
    }
    case mcap::Opcode::kDataEnd:
      over_ = true;
      return false;
    default:
      return false;
  }
}

std::optional<McapReader::Damage> McapReader::check_ending() {
  constexpr std::uint64_t kFooterSize = 9 + 20, kTail = kFooterSize + 8;
  const auto read_at = [&](std::uint64_t offset, std::uint64_t n) {
    std::string bytes(static_cast<std::size_t>(n), '\0');
    file_.clear();
    file_.seekg(static_cast<std::streamoff>(offset));
    file_.read(bytes.data(), static_cast<std::streamsize>(n));
    return bytes;
  };
  const auto cut = [&] { return Damage{position_, size_, "cut off before its end was written"}; };
  if (size_ < position_ + kTail) return cut();
  const std::string tail = read_at(size_ - kTail, kTail);
  const auto record = mcap::next_record(tail);
  if (std::string_view(tail).substr(kFooterSize) != mcap::kMagic || !record ||
      record->opcode != mcap::Opcode::kFooter)
    return cut();
  const auto footer = mcap::decode_footer(record->content);
  if (!footer || footer->summary_start > size_ - kTail) return cut();
  if (footer->summary_start == 0 || footer->summary_crc == 0)
    return std::nullopt;  // the writer left them out
  const std::string summary = read_at(footer->summary_start, size_ - 8 - 4 - footer->summary_start);
  if (mcap::crc32(summary) != footer->summary_crc)
    return Damage{footer->summary_start, size_, "the index's CRC does not match"};
  return std::nullopt;
}

Result<std::optional<McapMessage>> McapReader::next() {
  while (true) {
    loose_.reset();
    if (!unread_.empty()) {
      const auto record = mcap::next_record(unread_);
      if (!record) {
        unread_ = {};
        GNATHION_TRY(const bool more, damaged("a record inside a chunk is cut off", true));
        if (!more && over_) return std::optional<McapMessage>();
        if (!more) continue;
      }
      unread_.remove_prefix(record->total_size);
      GNATHION_TRY(const bool taken, take_record(record->opcode, record->content));
      if (!taken && over_) return std::optional<McapMessage>();
    } else {
      if (over_) return std::optional<McapMessage>();
      mcap::Opcode opcode{};
      const Step step = read_record(content_, opcode);
      if (step != Step::kRecord) {
        GNATHION_TRY(
            const bool more,
            damaged(step == Step::kEnd ? "ends without its end record" : "a record is cut off", false));
        if (!more && over_) return std::optional<McapMessage>();
        if (!more) continue;
      }
      GNATHION_TRY(const bool taken, take_record(opcode, content_));
      if (!taken && over_) return std::optional<McapMessage>();
    }
    if (!loose_) continue;
    const mcap::Channel& channel = channels_.at(loose_->channel_id);
    const auto schema = schemas_.find(channel.schema_id);
    return std::optional<McapMessage>(
        McapMessage{&channel, schema == schemas_.end() ? nullptr : &schema->second, *loose_});
  }
}

}  // namespace gnathion
