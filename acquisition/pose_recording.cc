#include "acquisition/pose_recording.h"

#include <unistd.h>

#include <algorithm>

#include "acquisition/mcap_reader.h"
#include "acquisition/mcap_writer.h"
#include "foxglove/FrameTransform.pb.h"
#include "gnathion/v1/recording.pb.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
namespace pb = gnathion::v1;
constexpr const char* kWhat = "cannot read motion";
constexpr const char* kStartTopic = "/session_start";

foxglove::FrameTransform pose_message(const std::string& body, const PoseRecord& r) {
  foxglove::FrameTransform m;
  m.mutable_timestamp()->set_seconds(r.capture.ns / 1'000'000'000);
  m.mutable_timestamp()->set_nanos(static_cast<int>(r.capture.ns % 1'000'000'000));
  m.set_parent_frame_id(r.parent);
  m.set_child_frame_id(body);
  const Vector3& t = r.camera_from_body.translation_mm;
  m.mutable_translation()->set_x(t.x());
  m.mutable_translation()->set_y(t.y());
  m.mutable_translation()->set_z(t.z());
  const Eigen::Quaterniond q(r.camera_from_body.rotation);
  m.mutable_rotation()->set_x(q.x());
  m.mutable_rotation()->set_y(q.y());
  m.mutable_rotation()->set_z(q.z());
  m.mutable_rotation()->set_w(q.w());
  return m;
}

pb::PoseStatus status_message(const std::string& body, const PoseRecord& r) {
  pb::PoseStatus m;
  m.set_sequence(r.sequence);
  m.set_body(body);
  m.set_valid(r.valid);
  m.set_reason(r.reason);
  m.set_rms_px(r.rms_px);
  m.set_tags(static_cast<std::uint32_t>(r.tags));
  m.set_capture_ns(r.capture.ns);
  if (r.valid)
    for (int i = 0; i < 36; ++i) m.add_covariance(r.covariance(i / 6, i % 6));
  return m;
}

pb::Event event_message(const EventSample& e) {
  pb::Event m;
  m.set_capture_ns(e.header.capture.ns);
  m.set_device_ns(e.header.device.ns);
  m.set_kind(e.kind);
  m.set_pressed(e.pressed);
  m.set_text(e.text);
  return m;
}

/// Writes all messages in order of capture time, as the file's index expects.
Status write_messages(McapWriter& mcap, const PoseRecording& poses) {
  const auto stamp = [](HostTime t) { return static_cast<std::uint64_t>(t.ns); };
  const std::uint16_t start = mcap.add_channel(kStartTopic, *pb::Event::descriptor());
  pb::Event marker;
  marker.set_capture_ns(poses.start.ns);
  marker.set_kind("session start");
  GNATHION_CHECK_OK(mcap.write(start, 0, stamp(poses.start), stamp(poses.start), marker.SerializeAsString()));
  for (const auto& [body, rows] : poses.bodies) {
    const std::uint16_t pose = mcap.add_channel("/" + body, *foxglove::FrameTransform::descriptor());
    const std::uint16_t status = mcap.add_channel("/" + body + "/status", *pb::PoseStatus::descriptor());
    for (const PoseRecord& r : rows) {
      if (r.valid) {
        GNATHION_CHECK_OK(mcap.write(pose, r.sequence, stamp(r.capture), stamp(r.capture),
                                     pose_message(body, r).SerializeAsString()));
      }
      GNATHION_CHECK_OK(mcap.write(status, r.sequence, stamp(r.capture), stamp(r.capture),
                                   status_message(body, r).SerializeAsString()));
    }
  }
  const std::uint16_t pedal = mcap.add_channel("/pedal", *pb::Event::descriptor());
  for (const EventSample& e : poses.events)
    GNATHION_CHECK_OK(mcap.write(pedal, e.header.sequence, stamp(e.header.capture), stamp(e.header.capture),
                                 event_message(e).SerializeAsString()));
  return {};
}

Rigid3 rigid_from(const foxglove::FrameTransform& m) {
  const auto& q = m.rotation();
  const Eigen::Quaterniond rotation = Eigen::Quaterniond(q.w(), q.x(), q.y(), q.z()).normalized();
  return {rotation.toRotationMatrix(), {m.translation().x(), m.translation().y(), m.translation().z()}};
}

bool good_rotation(const foxglove::FrameTransform& m) {
  const auto& q = m.rotation();
  const double n = q.x() * q.x() + q.y() * q.y() + q.z() * q.z() + q.w() * q.w();
  return std::abs(n - 1) < 1e-3 && rigid_from(m).translation_mm.allFinite();
}

/// Takes one message into `out`; `poses` keeps a pose until its status comes.
Status take(const McapMessage& m, const std::string& where,
            std::map<std::string, foxglove::FrameTransform>& poses, PoseRecording& out) {
  const std::string kind = m.schema ? m.schema->name : "";
  const auto parse = [&](auto& proto) {
    return proto.ParseFromArray(m.message.data.data(), static_cast<int>(m.message.data.size()));
  };
  if (kind == "foxglove.FrameTransform") {
    foxglove::FrameTransform pose;
    if (!parse(pose) || !good_rotation(pose)) return bad_input(kWhat, where, "a pose is damaged");
    poses[pose.child_frame_id()] = pose;
  } else if (kind == "gnathion.v1.PoseStatus") {
    pb::PoseStatus s;
    if (!parse(s)) return bad_input(kWhat, where, "a pose's status is damaged");
    PoseRecord r;
    r.sequence = s.sequence();
    r.capture.ns = s.capture_ns();
    r.valid = s.valid();
    r.reason = s.reason();
    r.rms_px = s.rms_px();
    r.tags = static_cast<int>(s.tags());
    if (r.valid) {
      const auto pose = poses.find(s.body());
      if (pose == poses.end() || s.covariance_size() != 36)
        return bad_input(kWhat, where, "a valid frame of '" + s.body() + "' has no pose");
      r.camera_from_body = rigid_from(pose->second);
      r.parent = pose->second.parent_frame_id();
      for (int i = 0; i < 36; ++i) r.covariance(i / 6, i % 6) = s.covariance(i);
      poses.erase(pose);
    }
    out.bodies[s.body()].push_back(std::move(r));
  } else if (kind == "gnathion.v1.Event") {
    pb::Event e;
    if (!parse(e)) return bad_input(kWhat, where, "an event is damaged");
    if (m.channel->topic == kStartTopic) {
      out.start.ns = e.capture_ns();
      return {};
    }
    EventSample sample;
    sample.header = {
        m.channel->topic.substr(1), m.message.sequence, {e.capture_ns()}, {e.capture_ns()}, {e.device_ns()}};
    sample.kind = e.kind();
    sample.pressed = e.pressed();
    sample.text = e.text();
    out.events.push_back(std::move(sample));
  }
  return {};
}

}  // namespace

Status write_poses(const fs::path& path, const PoseRecording& poses,
                   const std::map<std::string, std::string>& attachments) {
  const fs::path part =
      path.parent_path() / ("." + path.filename().string() + ".part." + std::to_string(::getpid()));
  const auto all = [&]() -> Status {
    GNATHION_TRY(auto mcap, McapWriter::create(part, {}));
    GNATHION_CHECK_OK(write_messages(*mcap, poses));
    for (const auto& [name, bytes] : attachments)
      GNATHION_CHECK_OK(mcap->attach(name, "application/octet-stream", bytes));
    return mcap->finish();
  };
  Status status = all();
  std::error_code ec;
  if (status) fs::rename(part, path, ec);
  if (ec) status = fail(ErrorCode::kInternal, "cannot write motion", path.string(), ec.message());
  if (!status) fs::remove(part, ec);
  return status;
}

Result<PoseRecording> read_poses(const fs::path& path) {
  GNATHION_TRY(auto reader, McapReader::open(path, McapReader::Ending::kMustBeWhole));
  PoseRecording out;
  std::map<std::string, foxglove::FrameTransform> poses;
  while (true) {
    GNATHION_TRY(const auto message, reader->next());
    if (!message) break;
    GNATHION_CHECK_OK(take(*message, path.string(), poses, out));
  }
  if (out.bodies.empty()) return bad_input(kWhat, path.string(), "holds no poses");
  for (auto& [body, rows] : out.bodies)
    std::stable_sort(rows.begin(), rows.end(), [](auto& a, auto& b) { return a.capture < b.capture; });
  return out;
}

}  // namespace gnathion
