#include "daemon/live_tracker.h"

#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <thread>

#include "daemon/jaw.h"
#include "tracking/body_tracker.h"

namespace gnathion::daemon {
namespace {

using FramePtr = std::shared_ptr<const LiveFrame>;

/// Frames of one instant, in the rig's order of cameras.
struct Instant {
  std::vector<FramePtr> frames;
  std::size_t count = 0;
  HostTime first_taken;
  const FramePtr& first() const {
    return *std::find_if(frames.begin(), frames.end(), [](const FramePtr& f) { return f != nullptr; });
  }
};

LivePose live_pose(const std::string& body, const BodyPose& pose) {
  LivePose live;
  live.body = body;
  live.reference = "rig";
  live.valid = pose.valid;
  live.reason = pose.reason;
  live.rms_px = pose.rms_px;
  live.tags = pose.tags_used;
  if (pose.valid) {
    live.reference_from_body = pose.camera_from_body;
    live.covariance = pose.covariance;
  }
  return live;
}

}  // namespace

struct LiveTracker::State {
  State(LiveTrackerOptions o, std::unique_ptr<BodyTracker> t, Publish p, std::function<void()> r, Clock& c)
      : options(std::move(o)),
        tracker(std::move(t)),
        publish(std::move(p)),
        round(std::move(r)),
        clock(c),
        jaw(options.bow_from_dental) {}

  void run();
  std::optional<Instant> wait_for_instant();
  LivePoses track(const Instant& instant);
  void note(const LivePoses& poses, const Instant& instant);

  const LiveTrackerOptions options;
  const std::unique_ptr<BodyTracker> tracker;
  const Publish publish;
  const std::function<void()> round;
  Clock& clock;
  JawFollower jaw;  ///< tracker's thread
  std::uint64_t index = 0;
  std::thread thread;

  mutable std::mutex mutex;  ///< of what follows
  std::condition_variable arrived;
  bool stopping = false;
  Instant gathering;  ///< not yet complete
  std::optional<Instant> ready;
  std::optional<HostTime> taken_up;  ///< the newest instant that was ready
  std::optional<std::string> mi;
  LiveTrackerStatus status;
  std::deque<std::pair<HostTime, double>> latencies_ms;
  std::map<std::string, LiveTags> tags;
};

Result<std::unique_ptr<LiveTracker>> LiveTracker::start(LiveTrackerOptions options, Publish publish,
                                                        std::function<void()> round, Clock& clock) {
  BodyTrackerOptions tracking;
  tracking.search_tiles = 12;  // no frame takes much longer than another
  GNATHION_TRY(auto tracker, BodyTracker::create(options.rig, tracking));
  auto state = std::make_unique<State>(std::move(options), std::move(tracker), std::move(publish),
                                       std::move(round), clock);
  state->gathering.frames.resize(state->options.rig.cameras.size());
  state->thread = std::thread([s = state.get()] { s->run(); });
  ::pthread_setname_np(state->thread.native_handle(), "tracker");
  return std::unique_ptr<LiveTracker>(new LiveTracker(std::move(state)));
}

LiveTracker::LiveTracker(std::unique_ptr<State> state) : state_(std::move(state)) {}

LiveTracker::~LiveTracker() {
  {
    std::lock_guard lock(state_->mutex);
    state_->stopping = true;
    state_->arrived.notify_all();
  }
  state_->thread.join();
}

void LiveTracker::take(FramePtr frame) {
  State& s = *state_;
  const auto& cameras = s.options.rig.cameras;
  const auto camera = std::find_if(cameras.begin(), cameras.end(),
                                   [&](const RigCamera& c) { return c.name == frame->frame.header.stream; });
  if (camera == cameras.end()) return;
  const auto slot = static_cast<std::size_t>(camera - cameras.begin());
  std::lock_guard lock(s.mutex);
  // Its instant has gone without it: a second pose of the same time, from one camera, would only be worse.
  const HostTime capture = frame->frame.header.capture;
  if (s.taken_up && capture.seconds_since(*s.taken_up) <= s.options.same_instant_s &&
      capture.seconds_since(*s.taken_up) > -1) {
    ++s.status.skipped;
    return;
  }
  const auto give = [&] {
    if (s.gathering.count == 0) return;
    if (s.ready) ++s.status.skipped;
    s.taken_up = s.gathering.first()->frame.header.capture;
    s.ready = std::move(s.gathering);
    s.gathering = Instant{std::vector<FramePtr>(cameras.size()), 0, {}};
    s.arrived.notify_all();
  };
  if (s.gathering.count > 0) {
    const HostTime other = s.gathering.first()->frame.header.capture;
    const double apart_s = frame->frame.header.capture.seconds_since(other);
    if (s.gathering.frames[slot] || std::abs(apart_s) > s.options.same_instant_s) give();
  }
  if (s.gathering.count == 0) s.gathering.first_taken = frame->taken;
  s.gathering.frames[slot] = std::move(frame);
  if (++s.gathering.count == cameras.size())
    give();
  else
    s.arrived.notify_all();
}

/// The newest instant, complete or no longer waited for; nothing when 50 ms are over.
std::optional<Instant> LiveTracker::State::wait_for_instant() {
  std::unique_lock lock(mutex);
  arrived.wait_for(lock, std::chrono::milliseconds(50),
                   [&] { return stopping || ready || gathering.count > 0; });
  if (!ready && gathering.count > 0 && !stopping)
    arrived.wait_for(lock, std::chrono::duration<double>(options.partner_wait_s),
                     [&] { return stopping || ready.has_value(); });
  if (!ready && gathering.count > 0) {
    taken_up = gathering.first()->frame.header.capture;
    ready = std::move(gathering);
    gathering = Instant{std::vector<FramePtr>(options.rig.cameras.size()), 0, {}};
  }
  if (mi) {
    jaw.mi_begins(*mi);
    mi.reset();
  }
  return std::exchange(ready, std::nullopt);
}

LivePoses LiveTracker::State::track(const Instant& instant) {
  MotionRow row;
  row.capture = instant.first()->frame.header.capture;
  row.sequence = instant.first()->frame.header.sequence;
  std::vector<const Image8*> images;
  for (const FramePtr& frame : instant.frames) {
    images.push_back(frame ? &frame->frame.image : nullptr);
    row.cameras += frame != nullptr;
  }
  BodyPoses bodies = tracker->next(row.capture, images);
  row.bow = std::move(bodies.bow);
  row.head = std::move(bodies.head);
  LivePoses poses;
  poses.index = ++index;
  poses.sequence = row.sequence;
  poses.capture = row.capture;
  poses.taken = instant.first_taken;
  poses.poses = {live_pose("bow", row.bow), live_pose("head_frame", row.head), jaw.next(row)};
  return poses;
}

/// For the live counts, and where the tags are.
void LiveTracker::State::note(const LivePoses& poses, const Instant& instant) {
  std::map<std::string, LiveTags> now_tags;
  for (std::size_t c = 0; c < instant.frames.size(); ++c) {
    if (!instant.frames[c]) continue;
    const RigCamera& camera = options.rig.cameras[c];
    LiveTags& in_frame = now_tags[camera.name];
    in_frame.sequence = instant.frames[c]->frame.header.sequence;
    for (std::size_t b = 0; b < 2; ++b) {
      if (!poses.poses[b].valid) continue;
      const TaggedBody& body = b == 0 ? options.rig.bow : options.rig.head_frame;
      for (const BodyTag& tag : body.tags)
        if (const auto corners = projected_tag(camera, tag, poses.poses[b].reference_from_body)) {
          LiveTag live{tag.id, poses.poses[b].body, {}};
          for (std::size_t k = 0; k < 4; ++k) {
            live.corners_px[2 * k] = static_cast<float>((*corners)[k].x());
            live.corners_px[2 * k + 1] = static_cast<float>((*corners)[k].y());
          }
          in_frame.tags.push_back(live);
        }
    }
  }
  std::lock_guard lock(mutex);
  for (auto& [stream, in_frame] : now_tags) tags[stream] = std::move(in_frame);
  ++status.poses;
  latencies_ms.emplace_back(poses.published, 1e3 * poses.published.seconds_since(poses.taken));
  while (poses.published.seconds_since(latencies_ms.front().first) > 1.0) latencies_ms.pop_front();
}

void LiveTracker::State::run() {
  while (true) {
    round();
    {
      std::lock_guard lock(mutex);
      if (stopping) return;
    }
    const std::optional<Instant> instant = wait_for_instant();
    if (!instant) continue;
    LivePoses poses = track(*instant);
    poses.published = clock.now();
    const LivePoses copy = poses;
    publish(std::move(poses));
    note(copy, *instant);
  }
}

void LiveTracker::mi_begins(const std::string& what) {
  std::lock_guard lock(state_->mutex);
  state_->mi = what;
}

LiveTrackerStatus LiveTracker::status() const {
  std::lock_guard lock(state_->mutex);
  LiveTrackerStatus s = state_->status;
  std::vector<double> sorted;
  for (const auto& [time, ms] : state_->latencies_ms) sorted.push_back(ms);
  s.rate_hz = static_cast<double>(sorted.size());
  if (sorted.empty()) return s;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  s.latency_ms = *middle;
  return s;
}

LiveTags LiveTracker::tags_in(const std::string& stream) const {
  std::lock_guard lock(state_->mutex);
  const auto found = state_->tags.find(stream);
  return found == state_->tags.end() ? LiveTags{} : found->second;
}

}  // namespace gnathion::daemon
