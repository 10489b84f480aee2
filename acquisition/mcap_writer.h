// Writes an MCAP file: chunked, compressed, indexed, CRC'd.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "acquisition/mcap_format.h"
#include "core/result.h"

namespace google::protobuf {
class Descriptor;
}

namespace gnathion {

/// A chunk is closed after max_chunk_ns of log time or max_chunk_bytes, whichever comes first: what a
/// crash can lose is the open chunk. One thread at a time.
class McapWriter {
 public:
  struct Options {
    std::string compression = "zstd";
    std::uint64_t max_chunk_ns = 100'000'000;
    std::size_t max_chunk_bytes = 4u << 20;
  };
  static Result<std::unique_ptr<McapWriter>> create(const std::filesystem::path& path, Options options);
  ~McapWriter();  ///< without finish() the file stays as after a crash: recoverable

  /// A protobuf channel; its schema is the descriptor's file set.
  std::uint16_t add_channel(const std::string& topic, const google::protobuf::Descriptor& type);
  /// Times in ns; `log_time` is arrival, `publish_time` capture.
  Status write(std::uint16_t channel, std::uint32_t sequence, std::uint64_t log_time,
               std::uint64_t publish_time, std::string_view data);
  Status attach(const std::string& name, const std::string& media_type, std::string_view data);
  /// Flushes the open chunk, writes the summary, syncs and closes.
  Status finish();

 private:
  struct State;
  explicit McapWriter(std::unique_ptr<State> state);
  Status flush_chunk();
  Status append(std::string_view bytes);
  std::string summary(std::string* offsets, std::uint64_t start) const;
  std::unique_ptr<State> state_;
};

}  // namespace gnathion
