#include <fmt/format.h>

#include "daemon/services/support.h"
#include "gnathion/v1/capture.grpc.pb.h"

namespace gnathion::daemon {
namespace {

api::SessionState::State state_of(State state) {
  return static_cast<api::SessionState::State>(state);
}
static_assert(static_cast<int>(State::kIdle) == api::SessionState::IDLE);
static_assert(static_cast<int>(State::kArmed) == api::SessionState::ARMED);
static_assert(static_cast<int>(State::kRecording) == api::SessionState::RECORDING);
static_assert(static_cast<int>(State::kStopping) == api::SessionState::STOPPING);

void fill(api::SessionState& to, const SessionView& from) {
  to.set_state(state_of(from.state));
  to.set_case_id(from.case_id);
  to.set_recording(from.recording);
  to.set_elapsed_s(from.elapsed_s);
  to.set_file_bytes(from.file_bytes);
  to.set_synced_bytes(from.synced_bytes);
  to.set_message(from.message);
  to.clear_devices_missing();
  for (const std::string& line : from.devices_missing) to.add_devices_missing(line);
  to.set_marks(from.marks);
}

/// Clients that answer for the session. When the last of them has gone and none comes within the grace, its
/// session is told.
class Holders {
 public:
  void come() {
    std::lock_guard lock(mutex_);
    ++holders_;
    ++changes_;
  }
  /// True: nobody holds any more, and it stayed so for `grace_s`.
  bool go(double grace_s, const std::atomic<bool>& going_down) {
    std::unique_lock lock(mutex_);
    const std::uint64_t mine = ++changes_;
    if (--holders_ > 0) return false;
    for (double left_s = grace_s; left_s > 0 && !going_down; left_s -= 0.05)
      if (changed_.wait_for(lock, std::chrono::milliseconds(50), [&] { return changes_ != mine; })) break;
    return holders_ == 0 && changes_ == mine && !going_down;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  int holders_ = 0;
  std::uint64_t changes_ = 0;
};

class CaptureService : public api::Capture::Service {
 public:
  explicit CaptureService(ServiceContext& context) : context_(context) {}

  grpc::Status Arm(grpc::ServerContext* call, const api::ArmRequest* request,
                   api::SessionState* response) override {
    return answer(*call, "capture.arm", request->case_id(), context_.session.arm(request->case_id()),
                  response);
  }
  grpc::Status Start(grpc::ServerContext* call, const api::StartRequest* request,
                     api::SessionState* response) override {
    return answer(*call, "capture.start", {}, context_.session.start(request->name()), response);
  }
  grpc::Status Stop(grpc::ServerContext* call, const api::StopRequest*,
                    api::SessionState* response) override {
    return answer(*call, "capture.stop", {}, context_.session.stop(), response);
  }
  grpc::Status Disarm(grpc::ServerContext* call, const api::DisarmRequest*,
                      api::SessionState* response) override {
    return answer(*call, "capture.disarm", {}, context_.session.disarm(), response);
  }

  grpc::Status Mark(grpc::ServerContext* call, const api::MarkRequest* request,
                    api::MarkResponse* response) override {
    MarkRequest mark;
    mark.kind = request->kind();
    mark.text = request->text();
    mark.capture.ns = request->capture_ns();
    using Edge = MarkRequest::Edge;
    mark.edge = request->edge() == api::MarkRequest::PRESS     ? Edge::kPress
                : request->edge() == api::MarkRequest::RELEASE ? Edge::kRelease
                                                               : Edge::kBoth;
    const auto place = context_.session.mark(mark);
    if (!place) return to_grpc(place.error());
    response->set_capture_ns(place->capture.ns);
    response->set_sequence(place->sequence);
    context_.audit.note(context_.who(*call), "capture.mark", context_.session.view().case_id, mark.kind);
    return grpc::Status::OK;
  }

  grpc::Status RequestScan(grpc::ServerContext* call, const api::ScanRequest*,
                           api::ScanResponse* response) override {
    const auto asked = context_.session.request_scan();
    if (!asked) return to_grpc(asked.error());
    response->set_scanners(static_cast<unsigned>(*asked));
    context_.audit.note(context_.who(*call), "capture.scan", context_.session.view().case_id);
    return grpc::Status::OK;
  }

  grpc::Status GetState(grpc::ServerContext*, const api::GetStateRequest*,
                        api::SessionState* response) override {
    fill(*response, context_.session.view());
    return grpc::Status::OK;
  }

  grpc::Status Watch(grpc::ServerContext* call, const api::WatchRequest* request,
                     grpc::ServerWriter<api::SessionState>* writer) override {
    auto slot = context_.streams.take();
    if (!slot) return to_grpc(slot.error());
    if (request->hold()) holders_.come();
    watch(*call, writer);
    if (request->hold() && holders_.go(context_.holder_grace_s, context_.going_down)) {
      context_.audit.note(context_.who(*call), "capture.holder_gone", context_.session.view().case_id);
      context_.session.holder_gone();
    }
    return grpc::Status::OK;
  }

 private:
  void watch(grpc::ServerContext& call, grpc::ServerWriter<api::SessionState>* writer) {
    const auto box = context_.session.changes().subscribe(1);
    api::SessionState state;
    while (!call.IsCancelled() && !context_.going_down && !box->closed()) {
      const auto mail = box->take_within(std::chrono::milliseconds(100));
      if (!mail) continue;
      fill(state, *mail->value);
      state.set_missed(mail->missed);
      if (!writer->Write(state)) return;
    }
  }

  grpc::Status answer(const grpc::ServerContext& call, const char* what, const std::string& case_id,
                      const ApiResult<SessionView>& view, api::SessionState* response) {
    if (!view) return refused(context_, call, what, case_id, view.error());
    fill(*response, *view);
    context_.audit.note(context_.who(call), what, view->case_id, view->recording);
    return grpc::Status::OK;
  }

  ServiceContext& context_;
  Holders holders_;
};

}  // namespace

std::unique_ptr<grpc::Service> make_capture_service(ServiceContext& context) {
  return std::make_unique<CaptureService>(context);
}

}  // namespace gnathion::daemon
