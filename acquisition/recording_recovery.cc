// Recovery works on messages, not on samples: what is whole is copied as it stands, other programs' channels
// too.
#include <algorithm>

#include "acquisition/mcap_writer.h"
#include "acquisition/recording.h"
#include "acquisition/recording_channels.h"
#include "acquisition/recording_messages.h"

namespace gnathion {
namespace {

class Recovery {
 public:
  Recovery(McapReader& reader, McapWriter& writer, std::string where)
      : reader_(reader), writer_(writer), where_(std::move(where)) {}

  Status run() {
    while (true) {
      GNATHION_TRY(const auto message, reader_.next());
      GNATHION_CHECK_OK(copy_attachments());
      if (!message) return {};
      GNATHION_CHECK_OK(copy(*message));
    }
  }
  std::uint64_t samples() const { return samples_; }

 private:
  /// Those that the reader has passed since the last message.
  Status copy_attachments() {
    for (; attachments_ < reader_.attachments().size(); ++attachments_) {
      const mcap::AttachmentIndex entry = reader_.attachments()[attachments_];
      GNATHION_TRY(const std::string bytes, reader_.attachment(entry.name));
      GNATHION_CHECK_OK(writer_.attach(entry.name, entry.media_type, bytes));
    }
    return {};
  }

  Status copy(const McapMessage& m) {
    const auto type = type_of(m);
    if (type == MessageType::kLedger) {
      GNATHION_TRY(const LedgerMessage ledger, decode_ledger(m.message.data, where_));
      const bool of_frame = ledger.line.fate == LedgerSample::Fate::kAccepted && !ledger.from_source;
      const SampleHeader& h = ledger.line.header;
      if (!of_frame) {
        gaps_.told(h.stream, h.sequence, ledger.line.count);
        ++samples_;
      }
      return write(m);
    }
    const SampleHeader h = header_from(m);
    if (type && is_counted(*type))
      if (const std::uint32_t lost = gaps_.take(h.stream, h.sequence); lost > 0) {
        SampleHeader first = h;
        first.sequence = h.sequence - lost;
        GNATHION_CHECK_OK(
            write_line({first, LedgerSample::Fate::kMissing, lost, "lost with a damaged part of the file"}));
      }
    if (type == MessageType::kScan && !files_are_there(m))
      return write_line({h, LedgerSample::Fate::kRejected, 1, "its files are damaged"});
    if (type != MessageType::kTransform) ++samples_;
    return write(m);
  }

  bool files_are_there(const McapMessage& m) {
    const auto scan = decode_scan(header_from(m), m.message.data, where_);
    return scan && std::all_of(scan->attachment_of_file.begin(), scan->attachment_of_file.end(),
                               [&](const auto& file) { return reader_.attachment(file.second).has_value(); });
  }

  Status write(const McapMessage& m) {
    const auto [known, added] = channels_.emplace(m.channel->id, std::uint16_t{0});
    if (added) {
      known->second = writer_.add_channel(*m.channel, m.schema ? *m.schema : mcap::Schema{});
      if (type_of(m) == MessageType::kLedger) ledger_channel_ = known->second;
    }
    const mcap::Message& x = m.message;
    return writer_.write(known->second, x.sequence, x.log_time, x.publish_time, x.data);
  }

  Status write_line(const LedgerSample& line) {
    if (!ledger_channel_)
      ledger_channel_ = writer_.add_channel(kLedgerTopic, descriptor_of(MessageType::kLedger));
    return writer_.write(*ledger_channel_, line.header.sequence,
                         static_cast<std::uint64_t>(line.header.arrival.ns),
                         static_cast<std::uint64_t>(line.header.capture.ns), encode_ledger(line, true));
  }

  McapReader& reader_;
  McapWriter& writer_;
  std::string where_;
  std::map<std::uint16_t, std::uint16_t> channels_;
  std::optional<std::uint16_t> ledger_channel_;
  GapDetector gaps_;
  std::size_t attachments_ = 0;
  std::uint64_t samples_ = 0;
};

}  // namespace

Result<std::uint64_t> recover_recording(const std::filesystem::path& damaged,
                                        const std::filesystem::path& out) {
  GNATHION_TRY(auto reader, McapReader::open(damaged, McapReader::Ending::kAsFarAsItGoes));
  GNATHION_TRY(auto writer, McapWriter::create(out, {}));
  Recovery recovery(*reader, *writer, damaged.string());
  GNATHION_CHECK_OK(recovery.run());
  GNATHION_CHECK_OK(writer->finish());
  return recovery.samples();
}

}  // namespace gnathion
