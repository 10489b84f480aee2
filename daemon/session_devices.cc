#include "daemon/session_devices.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "calibration/chain_json.h"
#include "core/file.h"
#include "core/log.h"

namespace gnathion::daemon {
namespace {

constexpr const char* kTrackerLoop = "tracker";
/// The session's own queue holds what the disk cannot take; this one only bridges two threads.
constexpr std::size_t kFeedBytes = std::size_t{32} << 20, kFeedReserveBytes = std::size_t{4} << 20;

Result<Transform<Bow, Dental>> read_bow_from_dental(const std::filesystem::path& chain_file) {
  GNATHION_TRY(const std::string text, read_file(chain_file));
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (json.is_discarded()) return bad_input("cannot read chain", chain_file.string(), "is not JSON");
  GNATHION_TRY(const Chain chain, chain_from_json(json, chain_file.string()));
  return chain.t_d();
}

}  // namespace

Result<std::shared_ptr<SessionDevices>> SessionDevices::open(const CaptureSetup& setup,
                                                             const TrackingFiles& files,
                                                             LiveChannels& channels, Heartbeats& heartbeats,
                                                             Clock& clock) {
  OpenedDevices opened = open_devices(setup.configs, clock);
  for (const std::string& line : opened.failures) log(LogLevel::kWarning, line);
  for (const std::string& line : opened.warnings) log(LogLevel::kWarning, line);
  if (opened.devices.empty())
    return bad_input("cannot arm", "devices.toml",
                     opened.failures.empty() ? "names no device" : opened.failures.front());
  std::shared_ptr<SessionDevices> session(new SessionDevices(channels, clock));
  session->missing_ = std::move(opened.failures);
  if (const Status tracking = session->start_tracker(files, heartbeats); !tracking)
    session->missing_.push_back("no live poses of the bow: " + tracking.error().line());
  for (auto& device : opened.devices) {
    if (auto* scanner = dynamic_cast<ScanOnRequest*>(device.get())) session->scanners_.push_back(scanner);
    if (auto* keeper = dynamic_cast<RemembersScans*>(device.get())) session->remembering_.push_back(keeper);
    // The lanes are this object's members: they end before it does.
    session->lanes_.push_back(std::make_unique<Lane>(
        std::move(device), [s = session.get()](const Sample& x, HostTime taken) { s->tell(x, taken); },
        clock));
  }
  return session;
}

SessionDevices::~SessionDevices() {
  lanes_.clear();
  tracker_.reset();
  if (heartbeats_) heartbeats_->end(kTrackerLoop);
}

Status SessionDevices::start_tracker(const TrackingFiles& files, Heartbeats& heartbeats) {
  if (files.rig.empty()) return {};  // sensors only, or pictures only
  LiveTrackerOptions options;
  GNATHION_TRY(options.rig, read_rig(files.rig));
  if (!files.chain.empty()) {
    GNATHION_TRY(const auto bow_from_dental, read_bow_from_dental(files.chain));
    options.bow_from_dental = bow_from_dental;
  }
  heartbeats_ = &heartbeats;
  heartbeats.begin(kTrackerLoop, 5.0);
  auto tracker = LiveTracker::start(
      std::move(options), [this](LivePoses poses) { publish(std::move(poses)); },
      [&heartbeats] { heartbeats.beat(kTrackerLoop); }, clock_);
  if (!tracker) {
    heartbeats.end(kTrackerLoop);
    return tl::unexpected<Error>(tracker.error());
  }
  tracker_ = std::move(*tracker);
  return {};
}

void SessionDevices::publish(LivePoses poses) {
  poses.index = ++poses_;
  channels_.poses.publish(std::make_shared<const LivePoses>(std::move(poses)));
}

void SessionDevices::tell(const Sample& sample, HostTime taken) {
  if (const auto* frame = std::get_if<FrameSample>(&sample)) {
    const bool watched = channels_.frames.has_subscribers();
    if (!tracker_ && !watched) return;
    const auto shared = std::make_shared<const LiveFrame>(LiveFrame{*frame, taken});
    if (tracker_) tracker_->take(shared);
    if (watched) channels_.frames.publish(shared);
  } else if (const auto* pose = std::get_if<PoseSample>(&sample)) {
    LivePose live;
    live.body = pose->body;
    live.reference = pose->reference;
    live.valid = pose->valid;
    live.reason = pose->reason;
    live.reference_from_body = pose->reference_from_body;
    publish({0, pose->header.sequence, pose->header.capture, taken, clock_.now(), {std::move(live)}});
  } else if (const auto* event = std::get_if<EventSample>(&sample)) {
    if (event->kind == "MI" && event->pressed)
      mi_begins(fmt::format("{} {}", event->header.stream, event->header.sequence));
    if (event->kind != "device") ++pedal_edges_;  // not the coming and going of one
    channels_.events.publish(std::make_shared<const EventSample>(*event));
  }
}

void SessionDevices::mi_begins(const std::string& what) {
  if (tracker_) tracker_->mi_begins(what);
}

std::vector<std::unique_ptr<Device>> SessionDevices::feeds() {
  std::vector<std::unique_ptr<Device>> feeds;
  for (const auto& lane : lanes_) feeds.push_back(lane->feed(kFeedBytes, kFeedReserveBytes));
  return feeds;
}

std::map<std::string, LiveCounts> SessionDevices::counts() const {
  std::map<std::string, LiveCounts> all;
  for (const auto& lane : lanes_)
    for (auto& [stream, counts] : lane->counts()) all[stream] = counts;
  return all;
}

std::vector<SessionDevice> SessionDevices::health() const {
  std::vector<SessionDevice> all;
  for (const auto& lane : lanes_) all.push_back({lane->description(), lane->health(), lane->ended()});
  return all;
}

bool SessionDevices::all_ended() const {
  for (const auto& lane : lanes_)
    if (!lane->ended()) return false;
  return true;
}

int SessionDevices::request_scans() {
  for (ScanOnRequest* scanner : scanners_) scanner->request_scan();
  return static_cast<int>(scanners_.size());
}

void SessionDevices::recording_failed() {
  for (RemembersScans* device : remembering_) device->recording_failed();
}

}  // namespace gnathion::daemon
