// Reads an MCAP file from front to back with the memory of one chunk.
#pragma once

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

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
    kAsFarAsItGoes,  ///< damaged records are passed over, a cut ends the reading; see damage()
  };
  static Result<std::unique_ptr<McapReader>> open(const std::filesystem::path& path, Ending ending);

  /// The next message; nothing at the end.
  Result<std::optional<McapMessage>> next();
  /// Attachments passed so far, by name (those of a recording stand behind its messages).
  const std::map<std::string, std::string>& attachments() const { return attachments_; }

  /// First damaged byte and why, once next() has come there (kAsFarAsItGoes).
  struct Damage {
    std::uint64_t begin = 0, end = 0;
    std::string why;
  };
  const std::optional<Damage>& damage() const { return damage_; }
  /// Checks what stands behind the messages (index, footer, closing magic); nothing when it is sound.
  std::optional<Damage> check_ending();
  std::uint64_t file_size() const { return size_; }
  /// Bytes read so far, for progress.
  std::uint64_t position() const { return position_; }

 private:
  McapReader() = default;
  enum class Step { kRecord, kEnd, kDamaged };
  Step read_record(std::string& content, mcap::Opcode& opcode);
  Result<bool> take_record(mcap::Opcode opcode, std::string_view content);
  Result<bool> take_chunk(std::string_view content);
  /// `can_go_on`: the record's length is sound, so that what follows can be read.
  Result<bool> damaged(const std::string& why, bool can_go_on);

  std::string path_;
  Ending ending_ = Ending::kMustBeWhole;
  std::ifstream file_;
  std::uint64_t size_ = 0, position_ = 0, record_start_ = 0;
  bool over_ = false;
  std::optional<Damage> damage_;
  std::map<std::uint16_t, mcap::Schema> schemas_;
  std::map<std::uint16_t, mcap::Channel> channels_;
  std::map<std::string, std::string> attachments_;
  std::string chunk_, content_;
  std::string_view unread_;             ///< rest of chunk_
  std::optional<mcap::Message> loose_;  ///< a message outside chunks, in content_
};

}  // namespace gnathion
