// What `gnathion recording info` and `verify` tell.
#include <algorithm>
#include <cmath>

#include "acquisition/recording.h"
#include "acquisition/recording_channels.h"
#include "acquisition/recording_messages.h"

namespace gnathion {
namespace {

const char* kind_of(MessageType type) {
  switch (type) {
    case MessageType::kImage:
      return "frames";
    case MessageType::kEvent:
      return "events";
    case MessageType::kPoseState:
      return "poses";
    case MessageType::kScan:
      return "scans";
    case MessageType::kTransfer:
      return "transfers";
    case MessageType::kLedger:
    case MessageType::kTransform:
      break;
  }
  return "";
}

double seconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-9;
}

/// Rate is that of the median step; jitter is the deviation of the steps from it, gaps left out: those are
/// told by the longest one. Samples of one instant (the sensors of one tracker frame) count as one.
void add_timing(StreamSummary& s, std::vector<std::int64_t> times, std::int64_t start_ns) {
  if (times.empty()) return;
  std::sort(times.begin(), times.end());
  s.first_s = seconds(times.front() - start_ns);
  s.last_s = seconds(times.back() - start_ns);
  times.erase(std::unique(times.begin(), times.end()), times.end());
  if (times.size() < 2) return;
  std::vector<double> steps_s;
  for (std::size_t i = 1; i < times.size(); ++i) steps_s.push_back(seconds(times[i] - times[i - 1]));
  std::vector<double> sorted = steps_s;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<long>(sorted.size() / 2), sorted.end());
  const double median_s = sorted[sorted.size() / 2];
  s.rate_hz = median_s > 0 ? 1.0 / median_s : 0.0;
  s.longest_gap_s = *std::max_element(steps_s.begin(), steps_s.end());
  double sum = 0;
  std::size_t n = 0;
  for (const double step : steps_s)
    if (step < 1.5 * median_s) {
      sum += (step - median_s) * (step - median_s);
      ++n;
    }
  s.jitter_ms = n ? 1e3 * std::sqrt(sum / static_cast<double>(n)) : 0.0;
}

/// Streams as they are read.
class Tally {
 public:
  Status take(const McapMessage& m, const std::string& where) {
    ++summary.messages;
    const auto type = type_of(m);
    if (type == MessageType::kTransform && is_of_pose_sample(m)) return {};
    if (type == MessageType::kLedger) {
      GNATHION_TRY(const LedgerMessage ledger, decode_ledger(m.message.data, where));
      take_line(ledger.line);
      return {};
    }
    const SampleHeader h = header_from(m);
    StreamSummary& s = summary.streams[h.stream];
    const std::string kind = type ? kind_of(*type) : "";
    s.kind = !kind.empty() ? kind : m.schema ? m.schema->name : "unknown";
    ++s.received;
    capture_ns_[h.stream].push_back(h.capture.ns);
    start_ns_ = std::min(start_ns_, h.capture.ns);
    end_ns_ = std::max(end_ns_, h.capture.ns);
    return {};
  }
  void finish() {
    for (auto& [name, times] : capture_ns_) add_timing(summary.streams[name], std::move(times), start_ns_);
    summary.duration_s = end_ns_ > start_ns_ ? seconds(end_ns_ - start_ns_) : 0.0;
  }
  RecordingSummary summary;

 private:
  /// A pose's transform only accompanies its state; other programs' transforms stand for themselves.
  static bool is_of_pose_sample(const McapMessage& m) { return m.channel->metadata.count(kStreamKey) > 0; }
  void take_line(const LedgerSample& line) {
    StreamSummary& s = summary.streams[line.header.stream];
    if (line.fate == LedgerSample::Fate::kMissing) s.missing += line.count;
    if (line.fate == LedgerSample::Fate::kRejected) s.rejected[line.reason] += line.count;
  }
  std::map<std::string, std::vector<std::int64_t>> capture_ns_;
  std::int64_t start_ns_ = INT64_MAX, end_ns_ = INT64_MIN;
};

}  // namespace

Result<RecordingSummary> summarise_recording(const std::filesystem::path& path) {
  GNATHION_TRY(auto reader, McapReader::open(path, McapReader::Ending::kAsFarAsItGoes));
  Tally tally;
  while (true) {
    GNATHION_TRY(const auto message, reader->next());
    if (!message) break;
    GNATHION_CHECK_OK(tally.take(*message, path.string()));
  }
  tally.finish();
  RecordingSummary summary = std::move(tally.summary);
  summary.bytes = reader->file_size();
  summary.chunks = reader->chunk_facts().count;
  summary.largest_chunk_bytes = reader->chunk_facts().largest_bytes;
  summary.longest_chunk_s = static_cast<double>(reader->chunk_facts().longest_ns) * 1e-9;
  for (const auto& a : reader->attachments())
    summary.attachments.push_back({a.name, a.media_type, a.data_size});
  const auto damage = reader->damage() ? reader->damage() : reader->check_ending();
  if (damage) {
    summary.whole = false;
    summary.damage_begin = damage->begin;
    summary.damage_end = damage->end;
    summary.damage = damage->why;
  }
  return summary;
}

}  // namespace gnathion
