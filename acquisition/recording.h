// Recordings: samples to MCAP and back, bit for bit.
//
// Topics: "/<stream>" holds foxglove.RawImage, gnathion.v1.Event, .SurfaceScan or .RawTransfer; poses are
// foxglove.FrameTransform there (valid ones, for other programs) and gnathion.v1.PoseState on
// "/<stream>/pose_state" (every one, complete); "/ledger" holds gnathion.v1.LedgerEntry. The channel's
// metadata names the stream, which may hold '/'. Each message's sequence, log_time and publish_time are the
// sample's counter, arrival and capture. docs/recording.md tells the policies.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/progress.h"
#include "core/source.h"

namespace gnathion {

class McapWriter;
class McapReader;
struct McapMessage;

struct RecordingOptions {
  std::string compression = "zstd";         ///< "zstd", "lz4" or "" (none)
  std::int64_t max_chunk_ns = 100'000'000;  ///< of arrival time
  std::size_t max_chunk_bytes = 4u << 20;
  /// Disk space is reserved ahead of the file, so that a full disk never cuts a chunk and always leaves room
  /// for the index. Where the file system cannot reserve, the last chunks make room.
  bool reserve_space = true;
};

/// The ledger of one stream so far.
struct LedgerCounts {
  std::uint64_t received = 0, missing = 0;
  std::map<std::string, std::uint64_t> rejected;  ///< by reason; at most 64 reasons, then "other"
};

/// An attachment as the index names it.
struct AttachmentInfo {
  std::string name, media_type;
  std::uint64_t bytes = 0;
};

/// Writes samples as they come. An accepted frame gets its ledger line by itself; counters of frames, poses,
/// scans and transfers that jump get a line "missing: counter gap". One thread at a time, but for sync(),
/// file_bytes() and synced_bytes().
class RecordingWriter {
 public:
  /// The file grows in place under its own name: after a crash it is there, to be recovered.
  static Result<RecordingWriter> create(const std::filesystem::path& path,
                                        const RecordingOptions& options = RecordingOptions());
  RecordingWriter(RecordingWriter&&) noexcept;
  ~RecordingWriter();
  /// An error is final: what follows is only counted, for the ledger lines that finish() writes.
  Status write(const Sample& sample);
  Status attach(const std::string& name, const std::string& media_type, const std::string& bytes);
  /// Closes the open chunk, so that a crash cannot lose it.
  Status flush();
  /// Makes durable what has been flushed.
  Status sync();
  /// Writes index and footer. After an error of write(): a valid file all the same where the disk still takes
  /// the reserved bytes, and that error again.
  Status finish();

  std::uint64_t file_bytes() const;    ///< handed to the kernel
  std::uint64_t synced_bytes() const;  ///< of these, durable
  const std::map<std::string, LedgerCounts>& ledger() const;

 private:
  struct State;
  explicit RecordingWriter(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Replays a recording: the same samples, bit for bit, in the order in which they were recorded. Ledger
/// lines of accepted frames are folded into their frames; the others come as LedgerSample. Memory: two
/// chunks, two samples, whatever the file's length.
class RecordingSource : public Source {
 public:
  /// Refuses a recording that was cut off.
  static Result<std::unique_ptr<RecordingSource>> open(const std::filesystem::path& path);
  ~RecordingSource() override;
  Result<std::optional<Sample>> next() override;
  /// From here on next() gives exactly those samples of the whole replay that arrived at `from` or later, in
  /// the same order. By the index; a file without one is read through.
  Status seek(HostTime from);
  /// Arrival of the first and the last sample; nothing when the file has no index or no samples.
  std::optional<std::pair<HostTime, HostTime>> time_range() const;
  /// Attachments are read one by one, when asked for.
  std::vector<AttachmentInfo> attachments() const;
  Result<std::string> attachment(const std::string& name);
  /// 0..1 of the file read.
  double fraction() const;

 private:
  explicit RecordingSource(std::unique_ptr<McapReader> reader, std::string path);
  Result<std::optional<Sample>> sample_from(const McapMessage& message);
  std::unique_ptr<McapReader> reader_;
  std::string path_;
  struct AcceptedLine {
    std::uint32_t sequence = 0;
    DeviceTime device;
  };
  std::map<std::string, AcceptedLine> accepted_;  ///< by stream: the line whose frame comes next
};

/// What a recording holds, stream by stream.
struct StreamSummary {
  std::string kind;  ///< "frames", "events", "poses", "scans", "transfers", or the schema's name
  std::uint64_t received = 0, missing = 0;
  std::map<std::string, std::uint64_t> rejected;  ///< by reason
  double first_s = 0, last_s = 0;                 ///< capture, seconds from the recording's first sample
  double rate_hz = 0, jitter_ms = 0, longest_gap_s = 0;
};
struct RecordingSummary {
  std::map<std::string, StreamSummary> streams;
  std::vector<AttachmentInfo> attachments;
  double duration_s = 0;
  std::uint64_t bytes = 0;
  std::uint64_t messages = 0, chunks = 0;
  double longest_chunk_s = 0;             ///< of arrival time
  std::uint64_t largest_chunk_bytes = 0;  ///< uncompressed
  bool whole = true;
  std::uint64_t damage_begin = 0, damage_end = 0;  ///< where not whole
  std::string damage;
};
/// Reads the whole file, checking every CRC; damage is told in the summary, not as an error.
Result<RecordingSummary> summarise_recording(const std::filesystem::path& path);

/// Copies every whole message and attachment of a damaged recording into a sound one, and adds a ledger line
/// for every sample that a counter shows to be lost. Returns how many samples.
Result<std::uint64_t> recover_recording(const std::filesystem::path& damaged,
                                        const std::filesystem::path& out);

/// Streams a source into a recording at `path`, with `attachments` (name → bytes). The file is removed
/// again when the source fails.
Status record(Source& source, const std::filesystem::path& path,
              const std::map<std::string, std::string>& attachments, double expected_frames,
              Progress& progress);

}  // namespace gnathion
