#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "daemon/preview.h"
#include "daemon/services/support.h"
#include "gnathion/v1/live.grpc.pb.h"

namespace gnathion::daemon {
namespace {

using std::chrono::milliseconds;
constexpr std::size_t kEventBacklog = 256;

void fill(api::LivePose& to, const LivePose& from) {
  api::PoseState& state = *to.mutable_state();
  state.set_reference(from.reference);
  state.set_body(from.body);
  state.set_valid(from.valid);
  state.set_reason(from.reason);
  if (from.valid) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) state.add_rotation(from.reference_from_body.rotation(i, j));
    for (int i = 0; i < 3; ++i) state.add_translation_mm(from.reference_from_body.translation_mm[i]);
  }
  to.set_rms_px(from.rms_px);
  to.set_tags(static_cast<unsigned>(from.tags));
  to.set_mi(from.mi);
  if (from.covariance)
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 6; ++j) to.add_covariance((*from.covariance)(i, j));
}

void fill(api::PoseUpdate& to, const LivePoses& from) {
  to.Clear();
  to.set_index(from.index);
  to.set_sequence(from.sequence);
  to.set_capture_ns(from.capture.ns);
  to.set_arrival_ns(from.taken.ns);
  to.set_published_ns(from.published.ns);
  for (const LivePose& pose : from.poses) fill(*to.add_pose(), pose);
}

void fill(api::LedgerUpdate& to, const LiveLedger& from) {
  to.Clear();
  to.set_time_ns(from.time.ns);
  for (const auto& [stream, counts] : from.streams) {
    api::StreamCounts& c = *to.add_stream();
    c.set_stream(stream);
    c.set_received(counts.received);
    c.set_missing(counts.missing);
    c.set_rejected(counts.rejected);
    c.set_rate_hz(counts.rate_hz);
    c.set_last_reason(counts.last_reason);
  }
  for (const SessionDevice& device : from.devices) daemon::fill(*to.add_device(), device);
  to.set_queue_fill(from.queue_fill);
  to.set_disk_mib_s(from.disk_mib_s);
  to.set_longest_sync_s(from.longest_sync_s);
  to.set_poses(from.poses);
  to.set_pose_rate_hz(from.tracker.rate_hz);
  to.set_pose_latency_ms(from.tracker.latency_ms);
  to.set_pose_frames_skipped(from.tracker.skipped);
}

class LiveService : public api::Live::Service {
 public:
  explicit LiveService(ServiceContext& context) : context_(context) {}

  grpc::Status Poses(grpc::ServerContext* call, const api::PosesRequest*,
                     grpc::ServerWriter<api::PoseUpdate>* writer) override {
    api::PoseUpdate update;
    return follow(*call, context_.channels.poses, 1, [&](const LivePoses& poses, std::uint64_t missed) {
      fill(update, poses);
      update.set_missed(missed);
      update.set_sent_ns(context_.clock.now().ns);
      return writer->Write(update, grpc::WriteOptions().set_no_compression());
    });
  }

  grpc::Status Events(grpc::ServerContext* call, const api::EventsRequest*,
                      grpc::ServerWriter<api::EventUpdate>* writer) override {
    return follow(*call, context_.channels.events, kEventBacklog,
                  [&](const EventSample& sample, std::uint64_t missed) {
                    api::EventUpdate update;
                    update.set_stream(sample.header.stream);
                    update.set_sequence(sample.header.sequence);
                    update.set_missed(missed);
                    api::Event& event = *update.mutable_event();
                    event.set_capture_ns(sample.header.capture.ns);
                    event.set_device_ns(sample.header.device.ns);
                    event.set_kind(sample.kind);
                    event.set_pressed(sample.pressed);
                    event.set_text(sample.text);
                    return writer->Write(update);
                  });
  }

  grpc::Status Previews(grpc::ServerContext* call, const api::PreviewsRequest* request,
                        grpc::ServerWriter<api::Preview>* writer) override {
    if (request->max_rate_hz() < 0 || request->max_rate_hz() > 30)
      return to_grpc({ApiCode::kInvalidArgument, "max_rate_hz is 0 (10) to 30"});
    if (request->max_width_px() > 1920)
      return to_grpc({ApiCode::kInvalidArgument, "max_width_px is 0 (480) to 1920"});
    const double rate_hz = request->max_rate_hz() > 0 ? request->max_rate_hz() : 10;
    const int width_px = request->max_width_px() > 0 ? static_cast<int>(request->max_width_px()) : 480;
    PreviewChooser chooser({request->stream().begin(), request->stream().end()}, rate_hz);
    // Two cameras come in turn: a few frames of backlog, so that none hides the other.
    return follow(*call, context_.channels.frames, 4, [&](const LiveFrame& live, std::uint64_t lost) {
      const auto missed = chooser.take(live, lost);
      if (!missed) return true;
      const SampleHeader& header = live.frame.header;
      const Image8 small = shrunk(live.frame.image, width_px);
      api::Preview preview;
      preview.set_stream(header.stream);
      preview.set_sequence(header.sequence);
      preview.set_capture_ns(header.capture.ns);
      preview.set_width_px(static_cast<unsigned>(small.width_px));
      preview.set_height_px(static_cast<unsigned>(small.height_px));
      preview.set_mono8(small.pixels.data(), small.pixels.size());
      preview.set_full_width_px(static_cast<unsigned>(live.frame.image.width_px));
      preview.set_full_height_px(static_cast<unsigned>(live.frame.image.height_px));
      preview.set_missed(*missed);
      for (const LiveTag& tag : context_.session.tags_in(header.stream).tags) {
        api::TagOutline& outline = *preview.add_tag();
        outline.set_id(tag.id);
        outline.set_body(tag.body);
        for (const float c : tag.corners_px) outline.add_corners_px(c);
      }
      return writer->Write(preview, grpc::WriteOptions().set_no_compression());
    });
  }

  grpc::Status Ledger(grpc::ServerContext* call, const api::LedgerRequest* request,
                      grpc::ServerWriter<api::LedgerUpdate>* writer) override {
    const double interval_s = request->interval_s() == 0 ? 0.25 : request->interval_s();
    if (!(interval_s >= 0.05 && interval_s <= 10))
      return to_grpc({ApiCode::kInvalidArgument, "interval_s is 0 (0.25) or 0.05 to 10"});
    auto slot = context_.streams.take();
    if (!slot) return to_grpc(slot.error());
    api::LedgerUpdate update;
    for (HostTime due = context_.clock.now(); !call->IsCancelled() && !context_.going_down;) {
      const HostTime now = context_.clock.now();
      if (now < due) {
        const auto left = milliseconds(std::clamp<std::int64_t>((due.ns - now.ns) / 1'000'000, 1, 50));
        std::this_thread::sleep_for(left);
        continue;
      }
      fill(update, context_.session.ledger());
      if (!writer->Write(update)) break;
      due.ns = std::max(due.ns + static_cast<std::int64_t>(1e9 * interval_s), now.ns);
    }
    return grpc::Status::OK;
  }

 private:
  /// Hands each value that the subscriber has time for to `send`, until it or the daemon goes.
  template <class T, class Send>
  grpc::Status follow(grpc::ServerContext& call, Hub<T>& hub, std::size_t depth, Send send) {
    auto slot = context_.streams.take();
    if (!slot) return to_grpc(slot.error());
    const auto box = hub.subscribe(depth);
    while (!call.IsCancelled() && !context_.going_down && !box->closed()) {
      const auto mail = box->take_within(milliseconds(100));
      if (mail && !send(*mail->value, mail->missed)) break;
    }
    return grpc::Status::OK;
  }

  ServiceContext& context_;
};

}  // namespace

std::unique_ptr<grpc::Service> make_live_service(ServiceContext& context) {
  return std::make_unique<LiveService>(context);
}

}  // namespace gnathion::daemon
