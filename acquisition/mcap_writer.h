// Writes an MCAP file: chunked, compressed, indexed, CRC'd.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "acquisition/mcap_format.h"
#include "core/result.h"

namespace google::protobuf {
class Descriptor;
}

namespace gnathion {

/// A chunk is closed when its log times would span more than max_chunk_ns or its bytes exceed max_chunk_bytes
/// (one message alone may): what a crash can lose is the open chunk.
///
/// A failed write is final. The open chunk is dropped, the file ends behind the last whole record, and
/// error() says why; finish() then still makes a valid file: index and footer go where a reserve of disk
/// space stood (an unlinked file beside the recording, given back at that moment), or, where that is not
/// enough (a limit on the file's size), drop_last_chunk() makes room.
///
/// One thread at a time, but for sync(), file_bytes() and synced_bytes().
class McapWriter {
 public:
  struct Options {
    std::string compression = "zstd";
    std::uint64_t max_chunk_ns = 100'000'000;
    std::size_t max_chunk_bytes = 4u << 20;
    bool reserve_space = false;
  };
  static Result<std::unique_ptr<McapWriter>> create(const std::filesystem::path& path, Options options);
  ~McapWriter();  ///< without finish() the file stays as after a crash: recoverable

  /// A protobuf channel; its schema is the descriptor's file set.
  std::uint16_t add_channel(const std::string& topic, const google::protobuf::Descriptor& type,
                            std::map<std::string, std::string> metadata = {});
  /// A channel as it stands in another file; ids are given anew. `schema.id` 0: none.
  std::uint16_t add_channel(const mcap::Channel& channel, const mcap::Schema& schema);
  /// Times in ns; `log_time` is arrival, `publish_time` capture. The message is `head` and then `body`.
  Status write(std::uint16_t channel, std::uint32_t sequence, std::uint64_t log_time,
               std::uint64_t publish_time, std::string_view head, std::string_view body = {});
  Status attach(const std::string& name, const std::string& media_type, std::string_view data);
  /// Closes the open chunk.
  Status flush();
  /// Makes what file_bytes() counts durable (fdatasync).
  Status sync();
  /// Flushes the open chunk, writes the summary, syncs and closes.
  Status finish();

  std::uint64_t file_bytes() const;    ///< handed to the kernel
  std::uint64_t synced_bytes() const;  ///< durable
  std::uint64_t chunks() const;        ///< closed so far
  /// Size of the index that finish() will write: this much memory grows with the file.
  std::uint64_t index_bytes() const;
  const std::optional<Error>& error() const;
  /// The error is one that room would mend: a full disk, a quota, a limit on the file's size.
  bool is_out_of_room() const;
  bool is_open() const;

  /// After an error: lets write(), flush() and finish() try again, with the reserve given back to the disk.
  void use_reserve();
  struct Dropped {
    std::uint16_t channel;
    std::uint32_t sequence;
    std::uint64_t log_time, publish_time;
  };
  /// Cuts the last chunk off the file and tells its messages; nothing, and nothing cut, when there is none or
  /// it cannot be read.
  std::optional<std::vector<Dropped>> drop_last_chunk();

 private:
  struct State;
  explicit McapWriter(std::unique_ptr<State> state);
  Status append(std::string_view a, std::string_view b = {}, std::string_view c = {});
  Status failed(int why_errno);
  void discard_open_chunk();
  void put_channel(std::uint16_t id);
  Status keep_reserve();
  std::string summary(std::string* offsets, std::uint64_t start) const;
  std::unique_ptr<State> state_;
};

}  // namespace gnathion
