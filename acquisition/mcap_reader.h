// Reads an MCAP file: from front to back with the memory of one chunk, from a time on by its index,
// attachments one by one.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acquisition/mcap_format.h"

namespace gnathion {

/// A message with what is known of its channel. Views live until the next call.
struct McapMessage {
  const mcap::Channel* channel = nullptr;
  const mcap::Schema* schema = nullptr;
  mcap::Message message;
};

/// One thread at a time. Messages come in file order; unknown records are skipped, as the
/// specification asks.
class McapReader {
 public:
  enum class Ending {
    kMustBeWhole,    ///< open() refuses a file without its footer, telling how to recover it
    kAsFarAsItGoes,  ///< every byte is read and checked; damaged records are passed over; see damage()
  };
  static Result<std::unique_ptr<McapReader>> open(const std::filesystem::path& path, Ending ending);
  ~McapReader();
  McapReader(const McapReader&) = delete;
  McapReader& operator=(const McapReader&) = delete;

  /// The next message; nothing at the end.
  Result<std::optional<McapMessage>> next();
  /// From here on next() gives the messages whose log time is `from` or later, in file order: by the index,
  /// or, in a file without a sound one, by reading it through.
  Status seek(std::uint64_t from);
  /// Log time of the first and the last message, by the file's statistics.
  std::optional<std::pair<std::uint64_t, std::uint64_t>> time_range() const;

  /// Those that the index names, or, without one, those passed so far.
  const std::vector<mcap::AttachmentIndex>& attachments() const { return attachments_; }
  /// An attachment's bytes, CRC checked. Of several of one name the last.
  Result<std::string> attachment(const std::string& name);

  /// First damaged bytes and why, once next() has come there (kAsFarAsItGoes).
  struct Damage {
    std::uint64_t begin = 0, end = 0;
    std::string why;
  };
  const std::optional<Damage>& damage() const { return damage_; }
  /// Checks what stands behind the messages (index, footer, closing magic); nothing when it is sound. To be
  /// called when next() has come to the end.
  std::optional<Damage> check_ending();
  std::uint64_t file_size() const { return size_; }
  /// Bytes read so far, for progress.
  std::uint64_t position() const { return position_; }

  struct ChunkFacts {
    std::uint64_t count = 0, largest_bytes = 0, longest_ns = 0;
  };
  const ChunkFacts& chunk_facts() const { return chunk_facts_; }

 private:
  McapReader() = default;
  enum class Step { kRecord, kEnd, kDamaged };
  bool read_at(std::uint64_t offset, std::uint64_t n, std::string& out) const;
  Step read_record(std::string& content, mcap::Opcode& opcode);
  bool wants_content(mcap::Opcode opcode) const;
  Result<bool> take_record(mcap::Opcode opcode, std::string_view content);
  Result<bool> take_chunk(std::string_view content);
  Result<bool> take_attachment();
  Result<bool> take_data_end(std::string_view content);
  /// `can_go_on`: the record's length is sound, so that what follows can be read.
  Result<bool> damaged(const std::string& why, bool can_go_on);

  // The index.
  void load_summary();
  bool summary_is_sound() const;
  std::pair<std::uint64_t, std::uint64_t> chunk_index_group(std::uint64_t summary_end) const;
  std::uint32_t crc_of(std::uint64_t begin, std::uint64_t end, std::uint32_t crc) const;
  std::uint64_t first_chunk_reaching(std::uint64_t from) const;

  // What kAsFarAsItGoes checks beyond the CRCs of chunks.
  std::string message_index_of_chunk(const mcap::Chunk& chunk);
  std::string message_index_damage(std::string_view content) const;
  std::optional<std::uint64_t> find_chunk_behind(std::uint64_t offset);

  std::string path_;
  Ending ending_ = Ending::kMustBeWhole;
  int fd_ = -1;
  std::uint64_t size_ = 0, position_ = 0, record_start_ = 0;
  bool over_ = false;
  std::uint64_t from_ = 0;
  std::optional<Damage> damage_;
  std::map<std::uint16_t, mcap::Schema> schemas_;
  std::map<std::uint16_t, mcap::Channel> channels_;
  std::vector<mcap::AttachmentIndex> attachments_;
  std::string chunk_, content_;
  std::string_view unread_;             ///< rest of chunk_
  std::optional<mcap::Message> loose_;  ///< a message outside chunks, in content_
  ChunkFacts chunk_facts_;

  bool has_summary_ = false;
  mcap::Footer footer_;
  std::optional<mcap::Statistics> statistics_;
  std::uint64_t chunk_index_begin_ = 0, chunk_index_end_ = 0;

  std::uint32_t running_crc_ = 0;
  std::map<std::uint16_t, std::vector<mcap::MessageIndexEntry>> chunk_messages_;
  int searches_left_ = 1000;
};

}  // namespace gnathion
