// The reader's use of the summary section: seeking, attachments.
#include <fmt/format.h>

#include <algorithm>

#include "acquisition/mcap_reader.h"
#include "core/check.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot read recording";
constexpr std::uint64_t kFooterSize = 9 + 20;
constexpr std::uint64_t kBlock = std::uint64_t{1} << 18;

std::uint64_t little_endian(std::string_view bytes, std::size_t at, std::size_t n) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < n; ++i)
    value |= static_cast<std::uint64_t>(static_cast<unsigned char>(bytes[at + i])) << (8 * i);
  return value;
}

}  // namespace

/// Schemas, channels, attachments and where the chunk index stands. A summary that does not hold together is
/// left alone: the file is then read through.
void McapReader::load_summary() {
  std::string tail;
  if (size_ < kFooterSize + mcap::kMagic.size() + position_ ||
      !read_at(size_ - kFooterSize - mcap::kMagic.size(), kFooterSize, tail))
    return;
  const auto footer_record = mcap::next_record(tail);
  const auto footer = footer_record && footer_record->opcode == mcap::Opcode::kFooter
                          ? mcap::decode_footer(footer_record->content)
                          : std::nullopt;
  const std::uint64_t end = size_ - kFooterSize - mcap::kMagic.size();
  if (!footer || footer->summary_start < position_ || footer->summary_start >= end) return;
  footer_ = *footer;
  if (!summary_is_sound()) return;
  constexpr std::uint64_t kHead = 9;
  const std::pair<std::uint64_t, std::uint64_t> chunk_group = chunk_index_group(end);
  std::string head, content;
  for (std::uint64_t at = footer_.summary_start; at < end;) {
    if (at == chunk_group.first && chunk_group.second > 0) {
      chunk_index_begin_ = at;
      at = chunk_index_end_ = at + chunk_group.second;
      continue;
    }
    if (end - at < kHead || !read_at(at, kHead, head)) return;
    const auto opcode = static_cast<mcap::Opcode>(head[0]);
    const std::uint64_t length = little_endian(head, 1, 8), next = at + kHead + length;
    if (length > end - at - kHead) return;
    if (opcode == mcap::Opcode::kChunkIndex) {
      if (chunk_index_begin_ == 0) chunk_index_begin_ = at;
      chunk_index_end_ = next;
    } else if (opcode == mcap::Opcode::kSchema || opcode == mcap::Opcode::kChannel ||
               opcode == mcap::Opcode::kStatistics || opcode == mcap::Opcode::kAttachmentIndex) {
      if (!read_at(at + kHead, length, content)) return;
      if (opcode == mcap::Opcode::kStatistics) statistics_ = mcap::decode_statistics(content);
      if (opcode == mcap::Opcode::kSchema)
        if (auto s = mcap::decode_schema(content)) schemas_.emplace(s->id, std::move(*s));
      if (opcode == mcap::Opcode::kChannel)
        if (auto c = mcap::decode_channel(content)) channels_.emplace(c->id, std::move(*c));
      if (opcode == mcap::Opcode::kAttachmentIndex)
        if (auto a = mcap::decode_attachment_index(content); a && ending_ == Ending::kMustBeWhole)
          attachments_.push_back(std::move(*a));
    }
    at = next;
  }
  has_summary_ = true;
}

/// Where all chunk indices stand, so that they need not be passed one by one: offset and length, 0 where the
/// file does not say.
std::pair<std::uint64_t, std::uint64_t> McapReader::chunk_index_group(std::uint64_t summary_end) const {
  const std::uint64_t begin = footer_.summary_offset_start;
  constexpr std::uint64_t kMost = 1u << 12;  // there are seven groups at most
  std::string bytes;
  if (begin <= footer_.summary_start || begin >= summary_end || summary_end - begin > kMost ||
      !read_at(begin, summary_end - begin, bytes))
    return {0, 0};
  std::string_view rest = bytes;
  while (const auto record = mcap::next_record(rest)) {
    if (record->opcode == mcap::Opcode::kSummaryOffset && record->content.size() == 17 &&
        static_cast<mcap::Opcode>(record->content[0]) == mcap::Opcode::kChunkIndex) {
      const std::uint64_t start = little_endian(record->content, 1, 8);
      const std::uint64_t length = little_endian(record->content, 9, 8);
      if (start >= footer_.summary_start && start <= begin && length <= begin - start) return {start, length};
    }
    rest.remove_prefix(record->total_size);
  }
  return {0, 0};
}

std::uint32_t McapReader::crc_of(std::uint64_t begin, std::uint64_t end, std::uint32_t crc) const {
  std::string block;
  for (; begin < end; begin += block.size()) {
    if (!read_at(begin, std::min(kBlock, end - begin), block)) return ~crc;
    crc = mcap::crc32(block, crc);
  }
  return crc;
}

/// A CRC of 0 means that the writer left it out.
bool McapReader::summary_is_sound() const {
  if (footer_.summary_crc == 0) return true;
  const std::uint64_t crc_field = size_ - mcap::kMagic.size() - 4;
  return crc_of(footer_.summary_start, crc_field, 0) == footer_.summary_crc;
}

std::optional<std::pair<std::uint64_t, std::uint64_t>> McapReader::time_range() const {
  if (!statistics_ || statistics_->message_count == 0) return std::nullopt;
  return std::pair(statistics_->start_time, statistics_->end_time);
}

/// Offset of the first chunk that holds log times of `from` or later; the file's size when none does. The
/// index is read in blocks and never kept.
std::uint64_t McapReader::first_chunk_reaching(std::uint64_t from) const {
  std::string block;
  std::uint64_t first = size_;
  for (std::uint64_t at = chunk_index_begin_; at < chunk_index_end_;) {
    if (!read_at(at, std::min(kBlock, chunk_index_end_ - at), block)) return first;
    std::string_view rest = block;
    while (const auto record = mcap::next_record(rest)) {
      if (record->opcode == mcap::Opcode::kChunkIndex && record->content.size() >= 32) {
        const std::uint64_t end_time = little_endian(record->content, 8, 8);
        if (end_time >= from) first = std::min(first, little_endian(record->content, 16, 8));
      }
      rest.remove_prefix(record->total_size);
    }
    const std::uint64_t used = block.size() - rest.size();
    if (used == 0) return first;  // an entry larger than a block: no writer makes one
    at += used;
  }
  return first;
}

Status McapReader::seek(std::uint64_t from) {
  GNATHION_CHECK(ending_ == Ending::kMustBeWhole);
  from_ = from;
  over_ = false;
  unread_ = {};
  loose_.reset();
  position_ = mcap::kMagic.size();
  if (!has_summary_) attachments_.clear();
  if (!has_summary_ || chunk_index_begin_ == 0) return {};
  const std::uint64_t first = first_chunk_reaching(from);
  if (first >= footer_.summary_start) {
    over_ = true;
  } else {
    position_ = std::max(position_, first);
  }
  return {};
}

Result<bool> McapReader::take_attachment() {
  constexpr std::uint64_t kHead = 9, kFixed = 16, kCrc = 4;
  const std::uint64_t content_begin = record_start_ + kHead;
  std::string head;
  // Name and media type stand before the data, which is not read here.
  const std::uint64_t length = position_ - content_begin;
  if (length < kFixed || !read_at(content_begin, std::min<std::uint64_t>(length, 1u << 16), head))
    return damaged("an attachment is damaged", true);
  const auto entry = mcap::decode_attachment_head(head);
  if (!entry || length < kCrc || entry->data_size > length ||
      entry->head_size + entry->data_size + kCrc != length)
    return damaged("an attachment's lengths do not fit", true);
  if (ending_ == Ending::kAsFarAsItGoes) {
    std::string crc;
    if (!read_at(position_ - kCrc, kCrc, crc)) return damaged("an attachment is damaged", true);
    const auto expected = static_cast<std::uint32_t>(little_endian(crc, 0, 4));
    if (expected != 0 && crc_of(content_begin, position_ - kCrc, 0) != expected)
      return damaged("an attachment's CRC does not match", true);
  }
  if (ending_ == Ending::kMustBeWhole && has_summary_) return false;
  mcap::AttachmentIndex index = entry->index;
  index.offset = record_start_;
  index.length = position_ - record_start_;
  attachments_.push_back(std::move(index));
  return false;
}

Result<std::string> McapReader::attachment(const std::string& name) {
  const auto found =
      std::find_if(attachments_.rbegin(), attachments_.rend(), [&](const auto& a) { return a.name == name; });
  if (found == attachments_.rend())
    return bad_input(kWhat, path_, fmt::format("has no attachment '{}'", name));
  std::string bytes;
  const auto bad = [&] { return bad_input(kWhat, path_, fmt::format("attachment '{}' is damaged", name)); };
  if (!read_at(found->offset, found->length, bytes)) return bad();
  const auto record = mcap::next_record(bytes);
  if (!record || record->opcode != mcap::Opcode::kAttachment) return bad();
  const auto attachment = mcap::decode_attachment(record->content);
  if (!attachment || attachment->name != name) return bad();
  const auto begin = static_cast<std::size_t>(attachment->data.data() - bytes.data());
  const std::size_t size = attachment->data.size();
  bytes.resize(begin + size);
  bytes.erase(0, begin);
  return bytes;
}

}  // namespace gnathion
