// What verifying and recovering look at beyond the CRCs of chunks.
#include <algorithm>

#include "acquisition/mcap_reader.h"

namespace gnathion {

/// Collects where the chunk's messages stand; tells what does not fit the chunk's own head.
std::string McapReader::message_index_of_chunk(const mcap::Chunk& chunk) {
  chunk_messages_.clear();
  std::uint64_t first = UINT64_MAX, last = 0;
  std::string_view rest = chunk_;
  while (const auto record = mcap::next_record(rest)) {
    if (record->opcode == mcap::Opcode::kMessage)
      if (const auto m = mcap::decode_message(record->content)) {
        chunk_messages_[m->channel_id].emplace_back(m->log_time, chunk_.size() - rest.size());
        first = std::min(first, m->log_time);
        last = std::max(last, m->log_time);
      }
    rest.remove_prefix(record->total_size);
  }
  for (auto& [channel, entries] : chunk_messages_) std::sort(entries.begin(), entries.end());
  if (!chunk_messages_.empty() && (first != chunk.start_time || last != chunk.end_time))
    return "a chunk's times do not fit its messages";
  return {};
}

std::string McapReader::message_index_damage(std::string_view content) const {
  auto index = mcap::decode_message_index(content);
  if (!index) return "a message index's lengths do not fit";
  std::sort(index->second.begin(), index->second.end());
  const auto found = chunk_messages_.find(index->first);
  const bool fits = found == chunk_messages_.end() ? index->second.empty() : found->second == index->second;
  return fits ? "" : "a message index does not fit its chunk";
}

std::optional<McapReader::Damage> McapReader::check_ending() {
  constexpr std::uint64_t kFooterSize = 9 + 20, kTail = kFooterSize + 8;
  const auto cut = [&] { return Damage{position_, size_, "cut off before its end was written"}; };
  std::string tail;
  if (size_ < position_ + kTail || !read_at(size_ - kTail, kTail, tail)) return cut();
  const auto record = mcap::next_record(tail);
  if (std::string_view(tail).substr(kFooterSize) != mcap::kMagic || !record ||
      record->opcode != mcap::Opcode::kFooter)
    return cut();
  const auto footer = mcap::decode_footer(record->content);
  if (!footer) return cut();
  if (footer->summary_start == 0) return std::nullopt;  // the writer left it out
  if (footer->summary_start != position_)
    return Damage{position_, size_, "the index does not stand behind the data"};
  footer_ = *footer;
  if (!summary_is_sound()) return Damage{footer->summary_start, size_, "the index's CRC does not match"};
  return std::nullopt;
}

/// The next place behind `offset` where a whole chunk begins, its CRC sound: behind a damaged length nothing
/// else tells where records begin.
std::optional<std::uint64_t> McapReader::find_chunk_behind(std::uint64_t offset) {
  constexpr std::uint64_t kBlock = std::uint64_t{1} << 20;
  constexpr std::size_t kToCompression = 9 + 8 + 8 + 8 + 4;  // from the opcode to the name of the compression
  static const std::string names[] = {std::string("\x04\0\0\0zstd", 8), std::string("\x03\0\0\0lz4", 7)};
  std::string block, head, record_bytes;
  for (std::uint64_t at = offset + 1; at < size_; at += kBlock) {
    // Blocks overlap, so that no candidate falls between them.
    if (!read_at(at, std::min(kBlock + kToCompression + 8, size_ - at), block)) return std::nullopt;
    std::vector<std::uint64_t> candidates;
    for (const std::string& name : names)
      for (std::size_t found = block.find(name); found != std::string::npos;
           found = block.find(name, found + 1))
        if (found >= kToCompression &&
            block[found - kToCompression] == static_cast<char>(mcap::Opcode::kChunk) &&
            found - kToCompression < kBlock)
          candidates.push_back(at + found - kToCompression);
    std::sort(candidates.begin(), candidates.end());
    for (const std::uint64_t candidate : candidates) {
      if (searches_left_-- <= 0) return std::nullopt;
      if (!read_at(candidate, 9, head)) continue;
      std::uint64_t length = 0;
      for (std::size_t i = 0; i < 8; ++i)
        length |= static_cast<std::uint64_t>(static_cast<unsigned char>(head[i + 1])) << (8 * i);
      if (length > size_ - candidate - 9 || !read_at(candidate + 9, length, record_bytes)) continue;
      const auto chunk = mcap::decode_chunk(record_bytes);
      if (chunk && mcap::decompress(*chunk, path_)) return candidate;
    }
  }
  return std::nullopt;
}

}  // namespace gnathion
