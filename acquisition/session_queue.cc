#include "acquisition/session_queue.h"

#include <algorithm>

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

namespace {

LedgerSample queue_full(const Sample& sample) {
  const auto* line = std::get_if<LedgerSample>(&sample);
  return line ? *line : LedgerSample{header_of(sample), LedgerSample::Fate::kRejected, 1, "queue full"};
}

/// Whether `next` goes on where `line` ends, so that one line can say both.
bool goes_on(const LedgerSample& line, const LedgerSample& next) {
  return line.header.stream == next.header.stream && line.fate == next.fate && line.reason == next.reason &&
         line.header.sequence + line.count == next.header.sequence;
}

}  // namespace

void SampleIntake::put(Sample sample) {
  const std::size_t bytes = memory_of(sample);
  if (std::holds_alternative<ScanSample>(sample)) {
    finish();  // older lines first, whatever the wait
    const LedgerSample lost = queue_full(sample);
    if (!queue_.push(std::move(sample), bytes)) pending_.push_back(lost);
    return;
  }
  const bool is_frame = std::holds_alternative<FrameSample>(sample);
  if (put_pending() && queue_.try_push(sample, bytes, is_frame ? 0 : reserve_)) return;
  reject(queue_full(sample));
}

void SampleIntake::reject(LedgerSample line) {
  const std::size_t bytes = memory_of(line);
  Sample sample = line;
  if (pending_.empty() && queue_.try_push(sample, bytes, reserve_)) return;
  // A few streams take turns: the line that this one goes on is among the last.
  constexpr std::size_t kLookBack = 16;
  for (std::size_t i = 0; i < std::min(kLookBack, pending_.size()); ++i) {
    LedgerSample& before = pending_[pending_.size() - 1 - i];
    if (before.header.stream != line.header.stream) continue;
    if (!goes_on(before, line)) break;
    before.count += line.count;
    return;
  }
  pending_.push_back(std::move(line));
}

/// True when none is left, so that lines never come behind samples that are younger.
bool SampleIntake::put_pending() {
  while (!pending_.empty()) {
    Sample sample = pending_.front();
    if (!queue_.try_push(sample, memory_of(sample), reserve_)) return false;
    pending_.pop_front();
  }
  return true;
}

void SampleIntake::finish() {
  for (LedgerSample& line : pending_) {
    Sample sample = std::move(line);
    const std::size_t bytes = memory_of(sample);
    queue_.push(std::move(sample), bytes);
  }
  pending_.clear();
}

}  // namespace gnathion
