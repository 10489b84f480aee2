#include "acquisition/recording.h"

#include <algorithm>

#include "acquisition/mcap_reader.h"
#include "acquisition/recording_channels.h"
#include "acquisition/recording_messages.h"

namespace gnathion {

RecordingSource::RecordingSource(std::unique_ptr<McapReader> reader, std::string path)
    : reader_(std::move(reader)), path_(std::move(path)) {}
RecordingSource::~RecordingSource() = default;

Result<std::unique_ptr<RecordingSource>> RecordingSource::open(const std::filesystem::path& path) {
  GNATHION_TRY(auto reader, McapReader::open(path, McapReader::Ending::kMustBeWhole));
  return std::unique_ptr<RecordingSource>(new RecordingSource(std::move(reader), path.string()));
}

double RecordingSource::fraction() const {
  return static_cast<double>(reader_->position()) /
         static_cast<double>(std::max<std::uint64_t>(1, reader_->file_size()));
}

Status RecordingSource::seek(HostTime from) {
  accepted_.clear();
  return reader_->seek(static_cast<std::uint64_t>(from.ns));
}

std::optional<std::pair<HostTime, HostTime>> RecordingSource::time_range() const {
  const auto range = reader_->time_range();
  if (!range) return std::nullopt;
  return std::pair(HostTime{static_cast<std::int64_t>(range->first)},
                   HostTime{static_cast<std::int64_t>(range->second)});
}

std::vector<AttachmentInfo> RecordingSource::attachments() const {
  std::vector<AttachmentInfo> all;
  for (const auto& a : reader_->attachments()) all.push_back({a.name, a.media_type, a.data_size});
  return all;
}

Result<std::string> RecordingSource::attachment(const std::string& name) {
  return reader_->attachment(name);
}

Result<std::optional<Sample>> RecordingSource::next() {
  while (true) {
    GNATHION_TRY(const auto message, reader_->next());
    if (!message) return std::optional<Sample>();
    GNATHION_TRY(std::optional<Sample> sample, sample_from(*message));
    if (sample) return sample;
  }
}

/// Nothing where the message is no sample by itself. Channels of other programs may stand in the file; they
/// are not ours to replay.
Result<std::optional<Sample>> RecordingSource::sample_from(const McapMessage& m) {
  const auto type = type_of(m);
  if (!type) return std::optional<Sample>();
  const std::string_view bytes = m.message.data;
  switch (*type) {
    case MessageType::kLedger: {
      GNATHION_TRY(LedgerMessage ledger, decode_ledger(bytes, path_));
      const SampleHeader& h = ledger.line.header;
      if (ledger.line.fate != LedgerSample::Fate::kAccepted || ledger.from_source)
        return std::optional<Sample>(std::move(ledger.line));
      accepted_[h.stream] = {h.sequence, h.device};
      return std::optional<Sample>();
    }
    case MessageType::kImage: {
      GNATHION_TRY(FrameSample frame, decode_image(header_from(m), bytes, path_));
      const auto line = accepted_.find(frame.header.stream);
      if (line != accepted_.end() && line->second.sequence == frame.header.sequence)
        frame.header.device = line->second.device;
      return std::optional<Sample>(std::move(frame));
    }
    case MessageType::kEvent: {
      GNATHION_TRY(EventSample event, decode_event(header_from(m), bytes, path_));
      return std::optional<Sample>(std::move(event));
    }
    case MessageType::kPoseState: {
      GNATHION_TRY(PoseSample pose, decode_pose_state(header_from(m), bytes, path_));
      return std::optional<Sample>(std::move(pose));
    }
    case MessageType::kTransfer: {
      GNATHION_TRY(TransferSample transfer, decode_transfer(header_from(m), bytes, path_));
      return std::optional<Sample>(std::move(transfer));
    }
    case MessageType::kScan: {
      GNATHION_TRY(ScanMessage scan, decode_scan(header_from(m), bytes, path_));
      for (const auto& [file, attachment] : scan.attachment_of_file) {
        GNATHION_TRY(scan.scan.files[file], reader_->attachment(attachment));
      }
      return std::optional<Sample>(std::move(scan.scan));
    }
    case MessageType::kTransform:
      break;
  }
  return std::optional<Sample>();
}

Status record(Source& source, const std::filesystem::path& path,
              const std::map<std::string, std::string>& attachments, double expected_frames,
              Progress& progress) {
  const auto all = [&]() -> Status {
    GNATHION_TRY(RecordingWriter writer, RecordingWriter::create(path));
    for (const auto& [name, bytes] : attachments)
      GNATHION_CHECK_OK(writer.attach(name, "application/octet-stream", bytes));
    double frames = 0;
    while (true) {
      GNATHION_TRY(const auto sample, source.next());
      if (!sample) break;
      GNATHION_CHECK_OK(writer.write(*sample));
      if (std::holds_alternative<FrameSample>(*sample))
        progress.update(std::min(1.0, ++frames / expected_frames));
    }
    return writer.finish();
  };
  std::error_code ec;
  const bool was_there = std::filesystem::exists(path, ec);
  const Status status = all();
  if (!status && !was_there) std::filesystem::remove(path, ec);
  return status;
}

}  // namespace gnathion
