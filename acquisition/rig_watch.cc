#include "acquisition/rig_watch.h"

#include <fmt/format.h>

#include <algorithm>

namespace gnathion {

RigWatch::RigWatch(RigOptions options) : stream_(options.name + "/sync"), grouper_(std::move(options.sync)) {
  counts_.name = std::move(options.name);
}

std::vector<EventSample> RigWatch::look_at(const Sample& sample) {
  const SampleHeader& header = header_of(sample);
  if (!grouper_.knows(header.stream)) return {};
  last_arrival_ = std::max(last_arrival_, header.arrival);
  if (const auto* line = std::get_if<LedgerSample>(&sample)) return told(grouper_.note(*line));
  if (!std::holds_alternative<FrameSample>(sample)) return {};
  // The header decides; the picture is not copied.
  return told(grouper_.add(std::make_shared<const FrameSample>(FrameSample{header, {}})));
}

std::vector<EventSample> RigWatch::finish() {
  return told(grouper_.finish());
}

std::vector<EventSample> RigWatch::told(const std::vector<FrameGrouper::Decision>& decisions) {
  std::vector<EventSample> events;
  for (const FrameGrouper::Decision& decision : decisions) {
    if (decision.lone.empty()) ++counts_.sets;
    for (const LedgerSample& line : decision.lone) {
      EventSample event;
      event.header = {stream_, static_cast<std::uint32_t>(counts_.lone++), line.header.capture, last_arrival_,
                      line.header.device};
      event.kind = "lone";
      event.pressed = false;
      event.text = fmt::format("{} {}: {}", line.header.stream, line.header.sequence, line.reason);
      events.push_back(std::move(event));
    }
  }
  return events;
}

}  // namespace gnathion
