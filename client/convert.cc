#include "client/convert.h"

#include <algorithm>
#include <array>

namespace gnathion::client {

DeviceInfo plain(const v1::Device& from) {
  constexpr std::array states = {"closed", "starting", "running", "recovering", "failed", "stopped"};
  DeviceInfo to;
  to.stream = from.stream();
  to.kind = from.kind();
  const auto state = static_cast<std::size_t>(from.state());
  to.state = state < states.size() ? states[state] : "unknown";
  to.message = from.message();
  to.vendor = from.vendor();
  to.model = from.model();
  to.serial = from.serial();
  to.settings.assign(from.settings().begin(), from.settings().end());
  to.warnings.assign(from.warnings().begin(), from.warnings().end());
  to.rate_hz = from.rate_hz();
  to.received = from.received();
  to.rejected = from.rejected();
  to.missing = from.missing();
  to.reconnects = from.reconnects();
  to.clock_jitter_ms = from.clock_jitter_ms();
  to.clock_drift_ppm = from.clock_drift_ppm();
  return to;
}

Health plain(const v1::HealthResponse& from) {
  Health to;
  to.well = from.well();
  to.version = from.version();
  to.memory_mib = from.memory_mib();
  to.connections = from.connections();
  to.streams = from.streams();
  to.faults.assign(from.fault().begin(), from.fault().end());
  for (const v1::Loop& loop : from.loop()) to.loops.push_back({loop.name(), loop.age_s(), loop.limit_s()});
  for (const v1::Device& device : from.device()) to.devices.push_back(plain(device));
  return to;
}

Session plain(const v1::SessionState& from) {
  Session to;
  to.state = static_cast<SessionState>(std::clamp(static_cast<int>(from.state()), 0, 3));
  to.case_id = from.case_id();
  to.recording = from.recording();
  to.message = from.message();
  to.elapsed_s = from.elapsed_s();
  to.file_bytes = from.file_bytes();
  to.synced_bytes = from.synced_bytes();
  to.marks = from.marks();
  to.devices_missing.assign(from.devices_missing().begin(), from.devices_missing().end());
  return to;
}

PoseUpdate plain(const v1::PoseUpdate& from) {
  PoseUpdate to;
  to.index = from.index();
  to.missed = from.missed();
  to.sequence = from.sequence();
  to.capture.ns = from.capture_ns();
  to.arrival.ns = from.arrival_ns();
  to.published.ns = from.published_ns();
  to.sent.ns = from.sent_ns();
  for (const v1::LivePose& p : from.pose()) {
    Pose pose;
    const v1::PoseState& state = p.state();
    pose.body = state.body();
    pose.reference = state.reference();
    pose.reason = state.reason();
    pose.valid = state.valid() && state.rotation_size() == 9 && state.translation_mm_size() == 3;
    if (pose.valid) {
      for (int i = 0; i < 9; ++i) pose.reference_from_body.rotation(i / 3, i % 3) = state.rotation(i);
      for (int i = 0; i < 3; ++i) pose.reference_from_body.translation_mm[i] = state.translation_mm(i);
    }
    if (p.covariance_size() == 36) pose.covariance.assign(p.covariance().begin(), p.covariance().end());
    pose.rms_px = p.rms_px();
    pose.tags = p.tags();
    pose.mi = p.mi();
    to.poses.push_back(std::move(pose));
  }
  return to;
}

EventUpdate plain(const v1::EventUpdate& from) {
  EventUpdate to;
  to.stream = from.stream();
  to.sequence = from.sequence();
  to.missed = from.missed();
  to.kind = from.event().kind();
  to.text = from.event().text();
  to.pressed = from.event().pressed();
  to.capture.ns = from.event().capture_ns();
  return to;
}

Preview plain(const v1::Preview& from) {
  Preview to;
  to.stream = from.stream();
  to.sequence = from.sequence();
  to.capture.ns = from.capture_ns();
  if (std::uint64_t{from.width_px()} * from.height_px() == from.mono8().size()) {
    to.image.width_px = static_cast<int>(from.width_px());
    to.image.height_px = static_cast<int>(from.height_px());
    to.image.pixels.assign(from.mono8().begin(), from.mono8().end());
  }
  to.full_width_px = static_cast<int>(from.full_width_px());
  to.full_height_px = static_cast<int>(from.full_height_px());
  to.missed = from.missed();
  for (const v1::TagOutline& tag : from.tag())
    to.tags.push_back({tag.id(), tag.body(), {tag.corners_px().begin(), tag.corners_px().end()}});
  return to;
}

LedgerUpdate plain(const v1::LedgerUpdate& from) {
  LedgerUpdate to;
  to.time.ns = from.time_ns();
  for (const v1::StreamCounts& c : from.stream())
    to.streams.push_back({c.stream(), c.last_reason(), c.received(), c.missing(), c.rejected(), c.rate_hz()});
  for (const v1::Device& device : from.device()) to.devices.push_back(plain(device));
  to.queue_fill = from.queue_fill();
  to.disk_mib_s = from.disk_mib_s();
  to.longest_sync_s = from.longest_sync_s();
  to.poses = from.poses();
  to.pose_frames_skipped = from.pose_frames_skipped();
  to.pose_rate_hz = from.pose_rate_hz();
  to.pose_latency_ms = from.pose_latency_ms();
  to.missed = from.missed();
  return to;
}

Job plain(const v1::Job& from) {
  Job to;
  to.id = from.job_id();
  to.case_id = from.case_id();
  to.kind = from.kind();
  to.step = from.step();
  to.message = from.message();
  to.who = from.who();
  to.state = static_cast<JobState>(std::clamp(static_cast<int>(from.state()), 0, 5));
  to.step_fraction = from.step_fraction();
  to.fraction = from.fraction();
  to.submitted.ns = from.submitted_ns();
  to.started.ns = from.started_ns();
  to.ended.ns = from.ended_ns();
  to.exit_code = from.exit_code();
  return to;
}

JobKind plain(const v1::JobKind& from) {
  constexpr std::array types = {"text", "number", "flag", "input", "output", "numbers"};
  JobKind to{from.name(), from.help(), {}};
  for (const v1::JobOption& option : from.option()) {
    const auto type = static_cast<std::size_t>(option.type());
    to.options.push_back(
        {option.name(), type < types.size() ? types[type] : "unknown", option.required(), option.repeated()});
  }
  return to;
}

Case plain(const v1::CaseInfo& from) {
  Case to;
  to.id = from.case_id();
  to.kind = from.kind();
  to.problem = from.problem();
  for (const v1::CaseFileInfo& file : from.file())
    to.files.push_back({file.path(), file.role(), file.sha256(), file.bytes(), file.modified_ns()});
  return to;
}

}  // namespace gnathion::client
