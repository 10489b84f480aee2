#include "acquisition/session_queue.h"

namespace gnathion {
namespace {

std::size_t payload_of(const FrameSample& x) {
  return x.image.pixels.size();
}
std::size_t payload_of(const EventSample& x) {
  return x.kind.size() + x.text.size();
}
std::size_t payload_of(const LedgerSample& x) {
  return x.reason.size();
}
std::size_t payload_of(const PoseSample& x) {
  return x.reference.size() + x.body.size() + x.reason.size();
}
std::size_t payload_of(const TransferSample& x) {
  return x.data.size();
}
std::size_t payload_of(const ScanSample& x) {
  std::size_t bytes = x.name.size() + x.sha256.size();
  for (const auto& [name, data] : x.files) bytes += name.size() + data.size();
  return bytes;
}

}  // namespace

std::size_t memory_of(const Sample& sample) {
  return sizeof(Sample) + header_of(sample).stream.size() +
         std::visit([](const auto& x) { return payload_of(x); }, sample);
}

void SampleIntake::put(Sample sample) {
  const bool lines_first = put_pending();
  const std::size_t bytes = memory_of(sample);
  if (lines_first && std::holds_alternative<ScanSample>(sample)) {
    queue_.push(std::move(sample), bytes);
    return;
  }
  const bool is_frame = std::holds_alternative<FrameSample>(sample);
  if (lines_first && queue_.try_push(sample, bytes, is_frame ? 0 : reserve_)) return;
  const auto* line = std::get_if<LedgerSample>(&sample);
  reject(line ? *line : LedgerSample{header_of(sample), LedgerSample::Fate::kRejected, 1, "queue full"});
}

void SampleIntake::reject(LedgerSample line) {
  const std::size_t bytes = memory_of(line);
  Sample sample = line;
  if (pending_.empty() && queue_.try_push(sample, bytes, reserve_)) return;
  const auto [known, added] = pending_.try_emplace({line.header.stream, line.reason}, line);
  if (!added) known->second.count += line.count;
}

/// True when none is left, so that lines never come behind samples that are younger.
bool SampleIntake::put_pending() {
  while (!pending_.empty()) {
    Sample sample = pending_.begin()->second;
    if (!queue_.try_push(sample, memory_of(sample), reserve_)) return false;
    pending_.erase(pending_.begin());
  }
  return true;
}

void SampleIntake::finish() {
  for (auto& [key, line] : pending_) {
    Sample sample = std::move(line);
    const std::size_t bytes = memory_of(sample);
    queue_.push(std::move(sample), bytes);
  }
  pending_.clear();
}

}  // namespace gnathion
