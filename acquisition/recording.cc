#include "acquisition/recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "acquisition/mcap_reader.h"
#include "acquisition/mcap_writer.h"
#include "foxglove/RawImage.pb.h"
#include "gnathion/v1/recording.pb.h"

namespace gnathion {
namespace {

namespace pb = gnathion::v1;
constexpr const char* kLedgerTopic = "/ledger";
constexpr const char* kWhat = "cannot read recording";

std::uint64_t as_unsigned(std::int64_t ns) {
  return static_cast<std::uint64_t>(ns);
}

pb::LedgerEntry to_proto(const LedgerSample& line) {
  pb::LedgerEntry entry;
  entry.set_stream(line.header.stream);
  entry.set_sequence(line.header.sequence);
  entry.set_count(line.count);
  entry.set_fate(static_cast<pb::LedgerEntry::Fate>(line.fate));
  entry.set_reason(line.reason);
  entry.set_capture_ns(line.header.capture.ns);
  entry.set_arrival_ns(line.header.arrival.ns);
  entry.set_device_ns(line.header.device.ns);
  return entry;
}

SampleHeader header_from(const McapMessage& m) {
  SampleHeader h;
  h.stream = m.channel->topic.substr(1);
  h.sequence = m.message.sequence;
  h.arrival.ns = static_cast<std::int64_t>(m.message.log_time);
  h.capture.ns = static_cast<std::int64_t>(m.message.publish_time);
  return h;
}

template <class Proto>
bool parse(const McapMessage& m, Proto& proto) {
  return proto.ParseFromArray(m.message.data.data(), static_cast<int>(m.message.data.size()));
}

Result<FrameSample> frame_from(const McapMessage& m, const std::string& path) {
  foxglove::RawImage image;
  if (!parse(m, image)) return bad_input(kWhat, path, "an image is damaged");
  if (image.encoding() != "mono8" || image.step() != image.width() || image.width() == 0 ||
      image.width() > 65536 || image.height() > 65536 ||
      std::uint64_t{image.width()} * image.height() != image.data().size())
    return bad_input(kWhat, path,
                     fmt::format("an image of {} is {} with {} bytes; mono8 is expected", m.channel->topic,
                                 image.encoding(), image.data().size()));
  FrameSample frame;
  frame.header = header_from(m);
  frame.image.width_px = static_cast<int>(image.width());
  frame.image.height_px = static_cast<int>(image.height());
  frame.image.pixels.assign(image.data().begin(), image.data().end());
  return frame;
}

Result<EventSample> event_from(const McapMessage& m, const std::string& path) {
  pb::Event event;
  if (!parse(m, event)) return bad_input(kWhat, path, "an event is damaged");
  EventSample sample{header_from(m), event.kind(), event.pressed(), event.text()};
  sample.header.device.ns = event.device_ns();
  return sample;
}

Result<LedgerSample> ledger_from(const McapMessage& m, const std::string& path) {
  pb::LedgerEntry entry;
  if (!parse(m, entry) || entry.fate() < 0 || entry.fate() > 2)
    return bad_input(kWhat, path, "a ledger line is damaged");
  LedgerSample line;
  line.header = {
      entry.stream(), entry.sequence(), {entry.capture_ns()}, {entry.arrival_ns()}, {entry.device_ns()}};
  line.count = entry.count();
  line.fate = static_cast<LedgerSample::Fate>(entry.fate());
  line.reason = entry.reason();
  return line;
}

}  // namespace

RecordingWriter::RecordingWriter() = default;
RecordingWriter::RecordingWriter(RecordingWriter&&) noexcept = default;
RecordingWriter::~RecordingWriter() = default;

Result<RecordingWriter> RecordingWriter::create(const std::filesystem::path& path) {
  RecordingWriter writer;
  GNATHION_TRY(writer.mcap_, McapWriter::create(path, {}));
  writer.channels_[kLedgerTopic] = writer.mcap_->add_channel(kLedgerTopic, *pb::LedgerEntry::descriptor());
  return writer;
}

Status RecordingWriter::write_ledger(const LedgerSample& line) {
  const SampleHeader& h = line.header;
  return mcap_->write(channels_.at(kLedgerTopic), h.sequence, as_unsigned(h.arrival.ns),
                      as_unsigned(h.capture.ns), to_proto(line).SerializeAsString());
}

Status RecordingWriter::write(const Sample& sample) {
  if (const auto* line = std::get_if<LedgerSample>(&sample)) {
    last_sequence_[line->header.stream] = line->header.sequence + line->count - 1;
    return write_ledger(*line);
  }
  const SampleHeader& h = header_of(sample);
  const std::string topic = "/" + h.stream;
  const auto* frame = std::get_if<FrameSample>(&sample);
  if (!channels_.count(topic))
    channels_[topic] =
        mcap_->add_channel(topic, frame ? *foxglove::RawImage::descriptor() : *pb::Event::descriptor());
  std::string bytes;
  if (frame) {
    const auto last = last_sequence_.find(h.stream);
    if (last != last_sequence_.end() && h.sequence > last->second + 1) {
      LedgerSample gap{h, LedgerSample::Fate::kMissing, h.sequence - last->second - 1, "counter gap"};
      gap.header.sequence = last->second + 1;
      GNATHION_CHECK_OK(write_ledger(gap));
    }
    last_sequence_[h.stream] = h.sequence;
    GNATHION_CHECK_OK(write_ledger({h, LedgerSample::Fate::kAccepted, 1, ""}));
    foxglove::RawImage image;
    image.mutable_timestamp()->set_seconds(h.capture.ns / 1'000'000'000);
    image.mutable_timestamp()->set_nanos(static_cast<int>(h.capture.ns % 1'000'000'000));
    image.set_frame_id(h.stream);
    image.set_width(static_cast<std::uint32_t>(frame->image.width_px));
    image.set_height(static_cast<std::uint32_t>(frame->image.height_px));
    image.set_step(image.width());
    image.set_encoding("mono8");
    image.set_data(frame->image.pixels.data(), frame->image.pixels.size());
    bytes = image.SerializeAsString();
  } else {
    const auto& event = std::get<EventSample>(sample);
    pb::Event message;
    message.set_capture_ns(h.capture.ns);
    message.set_device_ns(h.device.ns);
    message.set_kind(event.kind);
    message.set_pressed(event.pressed);
    message.set_text(event.text);
    bytes = message.SerializeAsString();
  }
  return mcap_->write(channels_.at(topic), h.sequence, as_unsigned(h.arrival.ns), as_unsigned(h.capture.ns),
                      bytes);
}

Status RecordingWriter::attach(const std::string& name, const std::string& media_type,
                               const std::string& bytes) {
  return mcap_->attach(name, media_type, bytes);
}

Status RecordingWriter::finish() {
  return mcap_->finish();
}

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

Result<std::optional<Sample>> RecordingSource::next() {
  while (true) {
    GNATHION_TRY(const auto message, reader_->next());
    if (!message) return std::optional<Sample>();
    const std::string kind = message->schema ? message->schema->name : "";
    if (kind == "gnathion.v1.LedgerEntry") {
      GNATHION_TRY(LedgerSample line, ledger_from(*message, path_));
      if (line.fate == LedgerSample::Fate::kAccepted) {
        pending_device_time_[line.header.stream] = line.header.device;
        continue;
      }
      return std::optional<Sample>(std::move(line));
    }
    if (kind == "foxglove.RawImage") {
      GNATHION_TRY(FrameSample frame, frame_from(*message, path_));
      frame.header.device = pending_device_time_[frame.header.stream];
      return std::optional<Sample>(std::move(frame));
    }
    if (kind == "gnathion.v1.Event") {
      GNATHION_TRY(EventSample event, event_from(*message, path_));
      return std::optional<Sample>(std::move(event));
    }
    // Channels of other programs may stand in the file; they are not ours to replay.
  }
}

namespace {

/// Times of one stream while a recording is read.
struct StreamTimes {
  std::vector<std::int64_t> capture_ns;
};

void finish_summary(StreamSummary& s, std::vector<std::int64_t> times, std::int64_t start_ns) {
  if (times.empty()) return;
  std::sort(times.begin(), times.end());
  s.first_s = static_cast<double>(times.front() - start_ns) * 1e-9;
  s.last_s = static_cast<double>(times.back() - start_ns) * 1e-9;
  if (times.size() < 2) return;
  std::vector<double> steps_s;
  for (std::size_t i = 1; i < times.size(); ++i)
    steps_s.push_back(static_cast<double>(times[i] - times[i - 1]) * 1e-9);
  std::vector<double> sorted = steps_s;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<long>(sorted.size() / 2), sorted.end());
  const double median_s = sorted[sorted.size() / 2];
  s.rate_hz = median_s > 0 ? 1.0 / median_s : 0.0;
  s.longest_gap_s = *std::max_element(steps_s.begin(), steps_s.end());
  double sum = 0;
  std::size_t n = 0;
  for (const double step : steps_s)
    if (step < 1.5 * median_s) {  // gaps are told apart; jitter is about the steps that came
      sum += (step - median_s) * (step - median_s);
      ++n;
    }
  s.jitter_ms = n ? 1e3 * std::sqrt(sum / static_cast<double>(n)) : 0.0;
}

}  // namespace

Result<RecordingSummary> summarise_recording(const std::filesystem::path& path) {
  GNATHION_TRY(auto reader, McapReader::open(path, McapReader::Ending::kAsFarAsItGoes));
  RecordingSummary summary;
  std::map<std::string, StreamTimes> times;
  std::int64_t start_ns = INT64_MAX, end_ns = INT64_MIN;
  while (true) {
    GNATHION_TRY(const auto message, reader->next());
    if (!message) break;
    const std::string kind = message->schema ? message->schema->name : "";
    if (kind == "gnathion.v1.LedgerEntry") {
      GNATHION_TRY(const LedgerSample line, ledger_from(*message, path.string()));
      StreamSummary& s = summary.streams[line.header.stream];
      if (line.fate == LedgerSample::Fate::kMissing) s.missing += line.count;
      if (line.fate == LedgerSample::Fate::kRejected) s.rejected[line.reason] += line.count;
      continue;
    }
    const SampleHeader h = header_from(*message);
    StreamSummary& s = summary.streams[h.stream];
    s.kind = kind == "foxglove.RawImage" ? "frames" : kind == "gnathion.v1.Event" ? "events" : kind;
    ++s.received;
    times[h.stream].capture_ns.push_back(h.capture.ns);
    start_ns = std::min(start_ns, h.capture.ns);
    end_ns = std::max(end_ns, h.capture.ns);
  }
  for (auto& [name, s] : summary.streams) finish_summary(s, times[name].capture_ns, start_ns);
  summary.duration_s = end_ns > start_ns ? static_cast<double>(end_ns - start_ns) * 1e-9 : 0.0;
  summary.bytes = reader->file_size();
  const auto damage = reader->damage() ? reader->damage() : reader->check_ending();
  if (damage) {
    summary.whole = false;
    summary.damage_begin = damage->begin;
    summary.damage_end = damage->end;
    summary.damage = damage->why;
  }
  return summary;
}

Result<std::uint64_t> recover_recording(const std::filesystem::path& damaged,
                                        const std::filesystem::path& out) {
  GNATHION_TRY(auto reader, McapReader::open(damaged, McapReader::Ending::kAsFarAsItGoes));
  RecordingSource source = RecordingSource(std::move(reader), damaged.string());
  GNATHION_TRY(RecordingWriter writer, RecordingWriter::create(out));
  std::uint64_t count = 0;
  while (true) {
    GNATHION_TRY(const auto sample, source.next());
    if (!sample) break;
    GNATHION_CHECK_OK(writer.write(*sample));
    ++count;
  }
  for (const auto& [name, bytes] : source.reader_->attachments())
    GNATHION_CHECK_OK(writer.attach(name, "application/octet-stream", bytes));
  GNATHION_CHECK_OK(writer.finish());
  return count;
}

Status record(Source& source, const std::filesystem::path& path,
              const std::map<std::string, std::string>& attachments, double expected_frames,
              Progress& progress) {
  const auto all = [&]() -> Status {
    GNATHION_TRY(RecordingWriter writer, RecordingWriter::create(path));
    double frames = 0;
    while (true) {
      GNATHION_TRY(const auto sample, source.next());
      if (!sample) break;
      GNATHION_CHECK_OK(writer.write(*sample));
      if (std::holds_alternative<FrameSample>(*sample))
        progress.update(std::min(1.0, ++frames / expected_frames));
    }
    for (const auto& [name, bytes] : attachments)
      GNATHION_CHECK_OK(writer.attach(name, "application/octet-stream", bytes));
    return writer.finish();
  };
  const Status status = all();
  if (!status) {
    std::error_code ec;
    std::filesystem::remove(path, ec);
  }
  return status;
}

}  // namespace gnathion
