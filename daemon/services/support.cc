#include "daemon/services/support.h"

#include <fmt/format.h>

namespace gnathion::daemon {

ApiResult<Slots::Slot> Slots::take() {
  if (++used_ > limit_) {
    --used_;
    return refuse(ApiCode::kResourceExhausted,
                  fmt::format("{} {} are open: close one, or raise '{}' in [limits] of gnathiond.toml",
                              limit_.load(), what_, key_));
  }
  return Slot(this);
}

std::string ServiceContext::who(const grpc::ServerContext& call) const {
  return peers ? peers->peer(call.peer()).who() : "unknown";
}

grpc::Status to_grpc(const ApiError& error) {
  using grpc::StatusCode;
  switch (error.code) {
    case ApiCode::kInvalidArgument:
      return {StatusCode::INVALID_ARGUMENT, error.message};
    case ApiCode::kNotFound:
      return {StatusCode::NOT_FOUND, error.message};
    case ApiCode::kFailedPrecondition:
      return {StatusCode::FAILED_PRECONDITION, error.message};
    case ApiCode::kAlreadyExists:
      return {StatusCode::ALREADY_EXISTS, error.message};
    case ApiCode::kResourceExhausted:
      return {StatusCode::RESOURCE_EXHAUSTED, error.message};
    case ApiCode::kPermissionDenied:
      return {StatusCode::PERMISSION_DENIED, error.message};
    case ApiCode::kUnavailable:
      return {StatusCode::UNAVAILABLE, error.message};
    case ApiCode::kInternal:
      break;
  }
  return {StatusCode::INTERNAL, error.message};
}

grpc::Status refused(ServiceContext& context, const grpc::ServerContext& call, const char* what,
                     const std::string& case_id, const ApiError& error) {
  if (error.code == ApiCode::kPermissionDenied)
    context.audit.note(context.who(call), std::string(what) + ".refused", case_id, error.message);
  return to_grpc(error);
}

namespace {

api::Device::State state_of(DeviceState state) {
  switch (state) {
    case DeviceState::kStarting:
      return api::Device::STARTING;
    case DeviceState::kRunning:
      return api::Device::RUNNING;
    case DeviceState::kRecovering:
      return api::Device::RECOVERING;
    case DeviceState::kFailed:
      return api::Device::FAILED;
    case DeviceState::kStopped:
      return api::Device::STOPPED;
  }
  return api::Device::FAILED;
}

}  // namespace

void fill(api::Device& to, const SessionDevice& from) {
  const DeviceDescription& d = from.description;
  to.set_stream(d.stream);
  to.set_kind(d.kind);
  to.set_state(state_of(from.health.state));
  to.set_message(from.health.message);
  to.set_vendor(d.vendor);
  to.set_model(d.model);
  to.set_serial(d.serial);
  for (const std::string& line : d.settings) to.add_settings(line);
  for (const std::string& line : d.warnings) to.add_warnings(line);
  to.set_rate_hz(from.health.rate_hz);
  to.set_received(from.health.received);
  to.set_rejected(from.health.rejected);
  to.set_missing(from.health.missing);
  to.set_reconnects(from.health.reconnects);
  to.set_clock_jitter_ms(from.health.clock.known ? from.health.clock.jitter_ms : 0);
  to.set_clock_drift_ppm(from.health.clock.known ? from.health.clock.drift_ppm : 0);
}

}  // namespace gnathion::daemon
