#include <set>

#include "acquisition/mcap_writer.h"
#include "acquisition/recording.h"
#include "acquisition/recording_channels.h"
#include "acquisition/recording_messages.h"

namespace gnathion {
namespace {

constexpr std::size_t kMostReasons = 64;

std::uint64_t as_unsigned(HostTime t) {
  return static_cast<std::uint64_t>(t.ns);
}

const char* suffix_of(MessageType type) {
  switch (type) {
    case MessageType::kImage:
      return "/image";
    case MessageType::kEvent:
      return "/event";
    case MessageType::kTransform:
      return "/transform";
    case MessageType::kPoseState:
      return "/pose_state";
    case MessageType::kScan:
      return "/scan";
    case MessageType::kTransfer:
      return "/transfer";
    case MessageType::kLedger:
      break;
  }
  return "/ledger";
}

/// Samples of one kind of fate that did not come into the file.
struct Lost {
  SampleHeader first;
  std::uint32_t count = 0;
};
using LostKey = std::tuple<std::string, LedgerSample::Fate, std::string>;  ///< stream, fate, reason

bool is_whole(const Image8& image) {
  return image.width_px >= 0 && image.height_px >= 0 &&
         static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px) ==
             image.pixels.size();
}

void add_lost(std::map<LostKey, Lost>& lost, const LostKey& key, const SampleHeader& header,
              std::uint32_t count) {
  Lost& l = lost[key];
  if (l.count == 0) l.first = header;
  l.count += count;
}

}  // namespace

struct RecordingWriter::State {
  std::unique_ptr<McapWriter> mcap;
  std::map<std::pair<std::string, MessageType>, std::uint16_t> channels;
  std::vector<std::pair<std::string, MessageType>> channel_owner;  ///< by channel id
  std::set<std::string> topics{kLedgerTopic}, attachments;
  GapDetector gaps;
  std::map<std::string, LedgerCounts> counts;
  std::map<LostKey, Lost> open_chunk, lost;  ///< reason "" stands for the writer's error
  std::uint64_t chunks = 0;
  std::optional<Error> error;
  bool finished = false;

  std::uint16_t channel(const std::string& stream, MessageType type);
  Status put(MessageType type, const SampleHeader& h, std::string_view head, std::string_view body = {});
  Status put_ledger(const LedgerSample& line, bool from_source);
  Status put_gap_before(const SampleHeader& h);
  Status put_frame(const FrameSample& frame);
  Status put_pose(const PoseSample& pose);
  Status put_scan(const ScanSample& scan);
  Status put_sample(const Sample& sample);
  Status put_attachment(const std::string& name, const std::string& media_type, std::string_view bytes);
  void count(const LedgerSample& line);
  void account(std::map<LostKey, Lost>& where, const Sample& sample);
  void forget_flushed();
  Status stop(const Error& why);
  Status put_lost_lines();
  bool drop_one_more_than(std::uint64_t chunks_before);
  void end_in_reserve();
};

std::uint16_t RecordingWriter::State::channel(const std::string& stream, MessageType type) {
  const auto known = channels.find({stream, type});
  if (known != channels.end()) return known->second;
  std::string topic = kLedgerTopic;
  std::map<std::string, std::string> metadata;
  if (type != MessageType::kLedger) {
    topic = "/" + valid_utf8(stream);
    if (type == MessageType::kPoseState) topic += suffix_of(type);
    while (!topics.insert(topic).second) topic += suffix_of(type);
    metadata[kStreamKey] = valid_utf8(stream);
  }
  const std::uint16_t id = mcap->add_channel(topic, descriptor_of(type), std::move(metadata));
  channels[{stream, type}] = id;
  channel_owner.emplace_back(stream, type);
  return id;
}

Status RecordingWriter::State::put(MessageType type, const SampleHeader& h, std::string_view head,
                                   std::string_view body) {
  const std::uint16_t id = channel(type == MessageType::kLedger ? "" : h.stream, type);
  return mcap->write(id, h.sequence, as_unsigned(h.arrival), as_unsigned(h.capture), head, body);
}

void RecordingWriter::State::count(const LedgerSample& line) {
  LedgerCounts& c = counts[line.header.stream];
  if (line.fate == LedgerSample::Fate::kMissing) c.missing += line.count;
  if (line.fate != LedgerSample::Fate::kRejected) return;
  const bool room = c.rejected.count(line.reason) || c.rejected.size() < kMostReasons;
  c.rejected[room ? line.reason : "other"] += line.count;
}

Status RecordingWriter::State::put_ledger(const LedgerSample& line, bool from_source) {
  GNATHION_CHECK_OK(put(MessageType::kLedger, line.header, encode_ledger(line, from_source)));
  count(line);
  return {};
}

Status RecordingWriter::State::put_gap_before(const SampleHeader& h) {
  const std::uint32_t missing = gaps.take(h.stream, h.sequence);
  if (missing == 0) return {};
  LedgerSample gap{h, LedgerSample::Fate::kMissing, missing, "counter gap"};
  gap.header.sequence = h.sequence - missing;
  return put_ledger(gap, false);
}

Status RecordingWriter::State::put_frame(const FrameSample& frame) {
  const SampleHeader& h = frame.header;
  GNATHION_CHECK_OK(put_ledger({h, LedgerSample::Fate::kAccepted, 1, ""}, false));
  const EncodedMessage message = encode_image(frame);
  return put(MessageType::kImage, h, message.head, message.body);
}

Status RecordingWriter::State::put_pose(const PoseSample& pose) {
  if (pose.valid) GNATHION_CHECK_OK(put(MessageType::kTransform, pose.header, encode_transform(pose)));
  return put(MessageType::kPoseState, pose.header, encode_pose_state(pose));
}

/// The files first: whoever meets the message finds them.
Status RecordingWriter::State::put_scan(const ScanSample& scan) {
  std::vector<std::string> names;
  for (const std::string& file : scan_file_order(scan)) {
    std::string name = valid_utf8(scan.header.stream + "/" + scan.name + "/" + file);
    while (attachments.count(name)) name += "'";
    GNATHION_CHECK_OK(put_attachment(name, "application/octet-stream", scan.files.at(file)));
    names.push_back(std::move(name));
  }
  return put(MessageType::kScan, scan.header, encode_scan(scan, names));
}

Status RecordingWriter::State::put_attachment(const std::string& name, const std::string& media_type,
                                              std::string_view bytes) {
  GNATHION_CHECK_OK(mcap->attach(name, media_type, bytes));
  attachments.insert(name);
  return {};
}

Status RecordingWriter::State::put_sample(const Sample& sample) {
  const SampleHeader& h = header_of(sample);
  if (const auto* line = std::get_if<LedgerSample>(&sample)) {
    gaps.told(h.stream, h.sequence, line->count);
    return put_ledger(*line, true);
  }
  const auto* event = std::get_if<EventSample>(&sample);
  if (!event) GNATHION_CHECK_OK(put_gap_before(h));
  if (const auto* frame = std::get_if<FrameSample>(&sample)) return put_frame(*frame);
  if (event) return put(MessageType::kEvent, h, encode_event(*event));
  if (const auto* pose = std::get_if<PoseSample>(&sample)) return put_pose(*pose);
  if (const auto* scan = std::get_if<ScanSample>(&sample)) return put_scan(*scan);
  return put(MessageType::kTransfer, h, encode_transfer(std::get<TransferSample>(sample)));
}

/// Remembers what the open chunk holds, in case it cannot be written.
void RecordingWriter::State::account(std::map<LostKey, Lost>& where, const Sample& sample) {
  const SampleHeader& h = header_of(sample);
  if (const auto* line = std::get_if<LedgerSample>(&sample)) {
    add_lost(where, {h.stream, line->fate, line->reason}, h, line->count);
  } else {
    add_lost(where, {h.stream, LedgerSample::Fate::kRejected, ""}, h, 1);
  }
}

void RecordingWriter::State::forget_flushed() {
  if (mcap->chunks() == chunks) return;
  chunks = mcap->chunks();
  open_chunk.clear();
}

Status RecordingWriter::State::stop(const Error& why) {
  error = why;
  forget_flushed();
  for (const auto& [key, l] : open_chunk) {
    add_lost(lost, key, l.first, l.count);
    if (std::get<2>(key).empty()) counts[std::get<0>(key)].received -= l.count;
  }
  open_chunk.clear();
  return tl::unexpected<Error>(why);
}

Status RecordingWriter::State::put_lost_lines() {
  for (const auto& [key, l] : lost) {
    const auto& [stream, fate, reason] = key;
    LedgerSample line{l.first, fate, l.count, reason.empty() ? "not written: " + error->why : reason};
    GNATHION_CHECK_OK(put(MessageType::kLedger, line.header, encode_ledger(line, true)));
  }
  return mcap->flush();
}

/// Makes room by cutting chunks off the file's end; their samples are lost too.
bool RecordingWriter::State::drop_one_more_than(std::uint64_t chunks_before) {
  while (mcap->chunks() > chunks_before)
    if (!mcap->drop_last_chunk()) return false;
  const auto dropped = mcap->drop_last_chunk();
  if (!dropped) return false;
  for (const McapWriter::Dropped& d : *dropped) {
    const auto& [stream, type] = channel_owner.at(d.channel);
    if (!is_sample(type)) continue;
    SampleHeader h{stream,
                   d.sequence,
                   {static_cast<std::int64_t>(d.publish_time)},
                   {static_cast<std::int64_t>(d.log_time)},
                   {}};
    Lost& l = lost[{stream, LedgerSample::Fate::kRejected, ""}];
    if (l.count == 0 || h.arrival < l.first.arrival) l.first = h;
    ++l.count;
    --counts[stream].received;
  }
  return true;
}

/// The disk takes no more: last ledger lines, index and footer go where the reserve stood.
void RecordingWriter::State::end_in_reserve() {
  while (mcap->is_open()) {
    mcap->use_reserve();
    const std::uint64_t before = mcap->chunks();
    if (put_lost_lines() && mcap->finish()) break;
    // A disk that fails in other ways keeps what it has; the file can be recovered.
    if (!mcap->is_open() || !mcap->is_out_of_room() || !drop_one_more_than(before)) break;
  }
  for (const auto& [key, l] : lost) {
    const auto& [stream, fate, reason] = key;
    count({l.first, fate, l.count, reason.empty() ? "not written: " + error->why : reason});
  }
}

RecordingWriter::RecordingWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
RecordingWriter::RecordingWriter(RecordingWriter&&) noexcept = default;
RecordingWriter::~RecordingWriter() = default;

Result<RecordingWriter> RecordingWriter::create(const std::filesystem::path& path,
                                                const RecordingOptions& options) {
  auto state = std::make_unique<State>();
  GNATHION_TRY(state->mcap, McapWriter::create(
                                path, {options.compression, static_cast<std::uint64_t>(options.max_chunk_ns),
                                       options.max_chunk_bytes, options.reserve_space}));
  return RecordingWriter(std::move(state));
}

Status RecordingWriter::write(const Sample& sample) {
  State& s = *state_;
  if (const auto* frame = std::get_if<FrameSample>(&sample); frame && !is_whole(frame->image))
    return write(LedgerSample{frame->header, LedgerSample::Fate::kRejected, 1, "pixels do not fit its size"});
  if (!s.error) {
    const Status status = s.put_sample(sample);
    s.forget_flushed();
    if (status) {
      s.account(s.open_chunk, sample);
      if (!std::holds_alternative<LedgerSample>(sample)) ++s.counts[header_of(sample).stream].received;
      return {};
    }
    (void)s.stop(status.error());
  }
  s.account(s.lost, sample);
  return tl::unexpected<Error>(*s.error);
}

Status RecordingWriter::attach(const std::string& name, const std::string& media_type,
                               const std::string& bytes) {
  State& s = *state_;
  if (s.error) return tl::unexpected<Error>(*s.error);
  const Status status = s.put_attachment(name, media_type, bytes);
  s.forget_flushed();
  return status ? Status() : s.stop(status.error());
}

Status RecordingWriter::flush() {
  State& s = *state_;
  if (s.error) return tl::unexpected<Error>(*s.error);
  const Status status = s.mcap->flush();
  s.forget_flushed();
  return status ? Status() : s.stop(status.error());
}

Status RecordingWriter::sync() {
  return state_->mcap->sync();
}

Status RecordingWriter::finish() {
  State& s = *state_;
  if (!s.finished) {
    s.finished = true;
    if (!s.error) {
      const Status status = s.mcap->finish();
      s.forget_flushed();
      if (!status) (void)s.stop(status.error());
    }
    if (s.error) s.end_in_reserve();
  }
  return s.error ? Status(tl::unexpected<Error>(*s.error)) : Status();
}

std::uint64_t RecordingWriter::file_bytes() const {
  return state_->mcap->file_bytes();
}
std::uint64_t RecordingWriter::synced_bytes() const {
  return state_->mcap->synced_bytes();
}
const std::map<std::string, LedgerCounts>& RecordingWriter::ledger() const {
  return state_->counts;
}

}  // namespace gnathion
