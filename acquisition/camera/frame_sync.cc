#include "acquisition/camera/frame_sync.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/check.h"

namespace gnathion {

std::size_t FrameSet::count() const {
  return static_cast<std::size_t>(
      std::count_if(frames.begin(), frames.end(), [](const auto& f) { return f != nullptr; }));
}

FrameGrouper::FrameGrouper(RigSyncOptions options) : options_(std::move(options)) {
  GNATHION_CHECK(!options_.streams.empty());
  if (options_.min_frames == 0 || options_.min_frames > options_.streams.size())
    options_.min_frames = options_.streams.size();
  streams_.resize(options_.streams.size());
  for (std::size_t i = 0; i < options_.streams.size(); ++i) index_[options_.streams[i]] = i;
}

bool FrameGrouper::knows(const std::string& stream) const {
  return index_.count(stream) > 0;
}

std::int64_t FrameGrouper::time_of(const SampleHeader& header) const {
  return options_.time_base == RigSyncOptions::TimeBase::kDeviceTime ? header.device.ns : header.capture.ns;
}

LedgerSample FrameGrouper::lone_line(const FrameSample& frame) const {
  return {frame.header, LedgerSample::Fate::kRejected, 1,
          fmt::format("no partner within {:.1f} ms", static_cast<double>(options_.tolerance_ns) * 1e-6)};
}

/// Moves the stream's time on. False for what comes behind it: too late for a set.
bool FrameGrouper::advance(Stream* stream, std::int64_t t_ns, std::vector<Decision>* out) {
  if (t_ns <= stream->latest_ns) {
    if (stream->latest_ns - t_ns <= options_.max_lag_ns) return false;
    decide_all(true, out);  // a clock that started anew: what waited has no partner to come
    for (Stream& s : streams_) s.latest_ns = INT64_MIN;
  }
  stream->latest_ns = t_ns;
  return true;
}

std::vector<FrameGrouper::Decision> FrameGrouper::add(std::shared_ptr<const FrameSample> frame,
                                                      std::uint64_t ticket) {
  std::vector<Decision> out;
  const auto found = index_.find(frame->header.stream);
  GNATHION_CHECK(found != index_.end());
  Stream& stream = streams_[found->second];
  const std::int64_t t_ns = time_of(frame->header);
  if (!advance(&stream, t_ns, &out)) {
    out.push_back({{}, {lone_line(*frame)}, {ticket}});
    return out;
  }
  stream.waiting.push_back({t_ns, std::move(frame), ticket});
  decide_all(false, &out);
  return out;
}

std::vector<FrameGrouper::Decision> FrameGrouper::note(const LedgerSample& line) {
  std::vector<Decision> out;
  const auto found = index_.find(line.header.stream);
  if (found == index_.end() || line.fate != LedgerSample::Fate::kRejected || time_of(line.header) <= 0)
    return out;
  if (advance(&streams_[found->second], time_of(line.header), &out)) decide_all(false, &out);
  return out;
}

std::vector<FrameGrouper::Decision> FrameGrouper::finish() {
  std::vector<Decision> out;
  decide_all(true, &out);
  return out;
}

/// How far the rig is: the newest time, but of one camera alone that is ahead of two others its clock is
/// wrong.
std::int64_t FrameGrouper::front_ns() const {
  std::vector<std::int64_t> latest_ns;
  for (const Stream& s : streams_) latest_ns.push_back(s.latest_ns);
  std::sort(latest_ns.rbegin(), latest_ns.rend());
  return latest_ns[latest_ns.size() > 2 ? 1 : 0];
}

/// Whether no frame that is yet to come can belong to the instant `earliest_ns`: every stream has shown one
/// beyond it, or is too far behind to be waited for.
bool FrameGrouper::decidable(std::int64_t earliest_ns) const {
  const std::int64_t front = front_ns();
  for (const Stream& s : streams_) {
    // A waiting frame is the stream's partner, or lies beyond; either way nothing earlier comes.
    if (!s.waiting.empty() || s.latest_ns > earliest_ns + options_.tolerance_ns) continue;
    const std::int64_t behind_ns = s.latest_ns == INT64_MIN ? earliest_ns : s.latest_ns;
    if (front != INT64_MIN && front - behind_ns > options_.max_lag_ns) continue;
    return false;
  }
  return true;
}

void FrameGrouper::decide_all(bool finishing, std::vector<Decision>* out) {
  for (;;) {
    const Stream* first = nullptr;
    const Stream* full = nullptr;  // its oldest must go, whatever the others do
    for (const Stream& s : streams_) {
      if (s.waiting.empty()) continue;
      if (!first || s.waiting.front().time_ns < first->waiting.front().time_ns) first = &s;
      if (s.waiting.size() > options_.max_waiting) full = &s;
    }
    if (!first) return;
    const std::int64_t at_ns = (full ? full : first)->waiting.front().time_ns;
    if (!finishing && !full && !decidable(at_ns)) return;
    out->push_back(decide(at_ns));
  }
}

/// A stream's oldest waiting frame with what lies within the tolerance of it: a set, or lone.
FrameGrouper::Decision FrameGrouper::decide(std::int64_t at_ns) {
  Decision decision;
  decision.set.frames.resize(streams_.size());
  std::int64_t sum_ns = 0;  // relative to the first member: absolute times would overflow
  std::int64_t base_ns = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < streams_.size(); ++i) {
    auto& waiting = streams_[i].waiting;
    if (waiting.empty() || std::abs(waiting.front().time_ns - at_ns) > options_.tolerance_ns) continue;
    const std::int64_t capture_ns = waiting.front().frame->header.capture.ns;
    if (count++ == 0) base_ns = capture_ns;
    sum_ns += capture_ns - base_ns;
    decision.tickets.push_back(waiting.front().ticket);
    decision.set.frames[i] = std::move(waiting.front().frame);
    waiting.pop_front();
  }
  if (count >= options_.min_frames) {
    decision.set.capture = {base_ns + sum_ns / static_cast<std::int64_t>(count)};
    return decision;
  }
  for (const auto& frame : decision.set.frames)
    if (frame) decision.lone.push_back(lone_line(*frame));
  decision.set = {};
  return decision;
}

RigSyncSource::RigSyncSource(Source& inner, RigSyncOptions options)
    : inner_(inner), grouper_(std::move(options)) {}

void RigSyncSource::apply(const std::vector<FrameGrouper::Decision>& decisions) {
  for (const auto& decision : decisions)
    for (std::size_t i = 0; i < decision.tickets.size(); ++i) {
      Slot& slot = slots_[static_cast<std::size_t>(decision.tickets[i] - first_ticket_)];
      if (!decision.lone.empty()) slot.sample = decision.lone[i];
      slot.decided = true;
    }
}

Result<std::optional<Sample>> RigSyncSource::next() {
  while (!over_ && (slots_.empty() || !slots_.front().decided)) {
    auto sample = inner_.next();
    if (!sample || !*sample) {
      if (!sample) error_ = sample.error();
      over_ = true;
      apply(grouper_.finish());
      break;
    }
    auto* frame = std::get_if<FrameSample>(&**sample);
    if (const auto* line = std::get_if<LedgerSample>(&**sample)) apply(grouper_.note(*line));
    if (!frame || !grouper_.knows(frame->header.stream)) {
      slots_.push_back({std::move(**sample), true});
      continue;
    }
    const std::uint64_t ticket = first_ticket_ + slots_.size();
    auto times_only = std::make_shared<const FrameSample>(FrameSample{frame->header, {}});
    slots_.push_back({std::move(**sample), false});
    apply(grouper_.add(std::move(times_only), ticket));
  }
  if (!slots_.empty()) {
    Sample sample = std::move(slots_.front().sample);
    slots_.pop_front();
    ++first_ticket_;
    return sample;
  }
  if (error_) return tl::unexpected<Error>(*error_);
  return std::nullopt;
}

}  // namespace gnathion
