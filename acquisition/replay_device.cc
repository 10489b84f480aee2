#include "acquisition/replay_device.h"

#include <fmt/format.h>

#include "acquisition/recording.h"

namespace gnathion {

ReplayDevice::ReplayDevice(std::unique_ptr<Source> source, DeviceDescription description, Clock& clock,
                           double speed)
    : description_(std::move(description)), waiter_(clock) {
  if (speed > 0)
    source_ = std::make_unique<PacedSource>(std::move(source), clock, waiter_, speed);
  else
    source_ = std::move(source);
}

Result<std::optional<Sample>> ReplayDevice::next() {
  {
    std::lock_guard lock(mutex_);
    if (stopped_) return std::optional<Sample>();
  }
  auto sample = source_->next();
  std::lock_guard lock(mutex_);
  if (!sample) {
    health_.state = DeviceState::kFailed;
    health_.message = sample.error().line();
  } else if (!*sample) {
    health_.state = DeviceState::kStopped;
    health_.message = stopped_ ? "stopped" : "at its end";
  } else {
    health_.state = DeviceState::kRunning;
    count(**sample);
  }
  return sample;
}

void ReplayDevice::count(const Sample& sample) {
  if (const auto* line = std::get_if<LedgerSample>(&sample)) {
    if (line->fate == LedgerSample::Fate::kRejected) health_.rejected += line->count;
    if (line->fate == LedgerSample::Fate::kMissing) health_.missing += line->count;
    return;
  }
  ++health_.received;
  constexpr double kRateWindow_s = 2;
  const HostTime arrival = header_of(sample).arrival;
  arrivals_.push_back(arrival);
  while (arrival.seconds_since(arrivals_.front()) > kRateWindow_s) arrivals_.pop_front();
  const double span_s = arrival.seconds_since(arrivals_.front());
  health_.rate_hz = span_s > 0 ? static_cast<double>(arrivals_.size() - 1) / span_s : 0.0;
}

DeviceHealth ReplayDevice::health() const {
  std::lock_guard lock(mutex_);
  return health_;
}

void ReplayDevice::stop() {
  std::lock_guard lock(mutex_);
  stopped_ = true;
  waiter_.cancel();
}

Result<std::unique_ptr<Device>> open_replay_device(const DeviceConfig& config, Clock& clock) {
  SettingsReader settings(config);
  const auto path = settings.path("path");
  const double speed = settings.number_in("speed", 0, 1000, 1);
  const double from_s = settings.number_in("from_s", 0, 1e9, 0);
  if (!path) settings.refuse("path", "must name a recording");
  GNATHION_CHECK_OK(settings.finish());
  auto opened = RecordingSource::open(*path);
  if (!opened) return in_context("cannot open device " + config.stream, opened.error());
  std::unique_ptr<RecordingSource> source = std::move(*opened);
  if (from_s > 0) {
    const auto range = source->time_range();
    if (!range)
      return bad_input("cannot open device", config.where,
                       fmt::format("'{}' has no index; leave out 'from_s'", path->string()));
    GNATHION_CHECK_OK(source->seek({range->first.ns + static_cast<std::int64_t>(from_s * 1e9)}));
  }
  DeviceDescription description;
  description.kind = config.kind;
  description.stream = config.stream;
  description.model = path->filename().string();
  description.settings = {fmt::format("speed: {}", speed), fmt::format("from_s: {}", from_s)};
  return std::unique_ptr<Device>(
      std::make_unique<ReplayDevice>(std::move(source), std::move(description), clock, speed));
}

}  // namespace gnathion
