// Recordings: samples to MCAP and back.
//
// Topics: "/<camera>" foxglove.RawImage, "/<stream>" gnathion.v1.Event, "/ledger" gnathion.v1.LedgerEntry.
// Each message's sequence, log_time and publish_time are the sample's counter, arrival and capture.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>

#include "core/progress.h"
#include "core/source.h"

namespace gnathion {

class McapWriter;
class McapReader;

/// Writes samples as they come. An accepted frame gets its ledger line by itself; counters that jump
/// get a line "missing: counter gap". One thread at a time.
class RecordingWriter {
 public:
  static Result<RecordingWriter> create(const std::filesystem::path& path);
  RecordingWriter(RecordingWriter&&) noexcept;
  ~RecordingWriter();
  Status write(const Sample& sample);
  Status attach(const std::string& name, const std::string& media_type, const std::string& bytes);
  Status finish();

 private:
  RecordingWriter();
  Status write_ledger(const LedgerSample& line);
  std::unique_ptr<McapWriter> mcap_;
  std::map<std::string, std::uint16_t> channels_;
  std::map<std::string, std::uint32_t> last_sequence_;
};

/// Replays a recording: the same samples, bit for bit, in the order in which they were recorded. Ledger
/// lines of accepted frames are folded into their frames; the others come as LedgerSample.
class RecordingSource : public Source {
 public:
  /// Refuses a recording that was cut off.
  static Result<std::unique_ptr<RecordingSource>> open(const std::filesystem::path& path);
  ~RecordingSource() override;
  Result<std::optional<Sample>> next() override;
  /// 0..1 of the file read.
  double fraction() const;
  friend Result<std::uint64_t> recover_recording(const std::filesystem::path&, const std::filesystem::path&);

 private:
  explicit RecordingSource(std::unique_ptr<McapReader> reader, std::string path);
  std::unique_ptr<McapReader> reader_;
  std::string path_;
  std::map<std::string, DeviceTime> pending_device_time_;
};

/// What a recording holds, stream by stream.
struct StreamSummary {
  std::string kind;  ///< "frames" or "events"
  std::uint64_t received = 0, missing = 0;
  std::map<std::string, std::uint64_t> rejected;  ///< by reason
  double first_s = 0, last_s = 0;                 ///< capture, seconds from the recording's first sample
  double rate_hz = 0, jitter_ms = 0, longest_gap_s = 0;
};
struct RecordingSummary {
  std::map<std::string, StreamSummary> streams;
  double duration_s = 0;
  std::uint64_t bytes = 0;
  bool whole = true;
  std::uint64_t damage_begin = 0, damage_end = 0;  ///< where not whole
  std::string damage;
};
/// Reads the whole file, checking every CRC; damage is told in the summary, not as an error.
Result<RecordingSummary> summarise_recording(const std::filesystem::path& path);

/// Copies every whole sample of a damaged recording into a sound one. Returns how many.
Result<std::uint64_t> recover_recording(const std::filesystem::path& damaged,
                                        const std::filesystem::path& out);

/// Streams a source into a recording at `path`, with `attachments` (name → bytes). The file is removed
/// again when the source fails.
Status record(Source& source, const std::filesystem::path& path,
              const std::map<std::string, std::string>& attachments, double expected_frames,
              Progress& progress);

}  // namespace gnathion
