// What writer, reader, summary and recovery of recordings share: how channels name streams, how counters
// jump.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "acquisition/mcap_reader.h"
#include "acquisition/recording_messages.h"
#include "core/sample.h"

namespace gnathion {

inline constexpr const char* kLedgerTopic = "/ledger";
inline constexpr const char* kStreamKey = "stream";  ///< in a channel's metadata

/// The stream that a channel belongs to; older recordings name it by the topic alone.
inline std::string stream_of(const mcap::Channel& channel) {
  const auto named = channel.metadata.find(kStreamKey);
  if (named != channel.metadata.end()) return named->second;
  return channel.topic.empty() || channel.topic[0] != '/' ? channel.topic : channel.topic.substr(1);
}

/// Stream, counter and host times of a message; the device time stands inside it.
inline SampleHeader header_from(const McapMessage& m) {
  SampleHeader h;
  h.stream = stream_of(*m.channel);
  h.sequence = m.message.sequence;
  h.arrival.ns = static_cast<std::int64_t>(m.message.log_time);
  h.capture.ns = static_cast<std::int64_t>(m.message.publish_time);
  return h;
}

inline std::optional<MessageType> type_of(const McapMessage& m) {
  return m.schema ? message_type_of(m.schema->name) : std::nullopt;
}

/// Messages that stand for one sample each (a FrameTransform only accompanies its PoseState).
inline bool is_sample(MessageType type) {
  return type != MessageType::kTransform && type != MessageType::kLedger;
}
/// Samples whose counter runs without gaps when nothing is lost.
inline bool is_counted(MessageType type) {
  return is_sample(type) && type != MessageType::kEvent;
}

/// Counters of streams. They may wrap, and begin anew after an instrument was reset.
class GapDetector {
 public:
  /// How many counters are missing before `sequence`.
  std::uint32_t take(const std::string& stream, std::uint32_t sequence) {
    const auto [last, first] = last_.emplace(stream, sequence);
    const std::uint32_t step = sequence - last->second;
    last->second = sequence;
    return !first && step > 1 && step < kHalf ? step - 1 : 0;
  }
  /// A ledger line tells of `count` counters from `sequence` on.
  void told(const std::string& stream, std::uint32_t sequence, std::uint32_t count) {
    if (count == 0) return;
    const auto [last, first] = last_.emplace(stream, sequence + count - 1);
    // A line may speak of an old counter (a duplicate); the next frame's gap must not be counted from there.
    if (!first && sequence + count - 1 - last->second < kHalf) last->second = sequence + count - 1;
  }

 private:
  static constexpr std::uint32_t kHalf = 1u << 31;
  std::map<std::string, std::uint32_t> last_;
};

}  // namespace gnathion
