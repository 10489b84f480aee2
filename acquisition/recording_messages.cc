#include "acquisition/recording_messages.h"

#include <fmt/format.h>
#include <google/protobuf/stubs/logging.h>

#include <algorithm>
#include <array>

#include "foxglove/FrameTransform.pb.h"
#include "foxglove/RawImage.pb.h"
#include "gnathion/v1/recording.pb.h"

namespace gnathion {
namespace {

namespace pb = gnathion::v1;
constexpr const char* kWhat = "cannot read recording";

const std::map<std::string, MessageType>& types_by_name() {
  static const std::map<std::string, MessageType> table = [] {
    std::map<std::string, MessageType> made;
    for (int i = 0; i <= static_cast<int>(MessageType::kTransfer); ++i)
      made[descriptor_of(static_cast<MessageType>(i)).full_name()] = static_cast<MessageType>(i);
    return made;
  }();
  return table;
}

/// Length of the UTF-8 sequence at the start of `s` (RFC 3629), 0 where there is none.
std::size_t utf8_length(std::string_view s) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(s[i]); };
  const unsigned char b = byte(0);
  const std::size_t n = b < 0x80 ? 1 : b < 0xC2 ? 0 : b < 0xE0 ? 2 : b < 0xF0 ? 3 : b < 0xF5 ? 4 : 0;
  if (n == 0 || n > s.size()) return 0;
  for (std::size_t i = 1; i < n; ++i)
    if ((byte(i) & 0xC0) != 0x80) return 0;
  if ((b == 0xE0 && byte(1) < 0xA0) || (b == 0xED && byte(1) > 0x9F) || (b == 0xF0 && byte(1) < 0x90) ||
      (b == 0xF4 && byte(1) > 0x8F))
    return 0;
  return n;
}

template <class Message>
void stamp(Message& message, HostTime capture) {
  constexpr std::int64_t kSecond = 1'000'000'000;
  const std::int64_t nanos = ((capture.ns % kSecond) + kSecond) % kSecond;
  message.mutable_timestamp()->set_seconds((capture.ns - nanos) / kSecond);
  message.mutable_timestamp()->set_nanos(static_cast<int>(nanos));
}

/// A damaged message is told by its reader, in one line; protobuf's own log would add others.
template <class Message>
bool parse(std::string_view bytes, Message& message) {
  static const auto previous_handler = google::protobuf::SetLogHandler(nullptr);
  (void)previous_handler;
  return message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

/// A base-128 number of the wire format.
void append_varint(std::string& out, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) out += static_cast<char>((value & 0x7F) | 0x80);
  out += static_cast<char>(value);
}

bool is_mesh_name(const std::string& name) {
  static const std::array<const char*, 3> endings = {".obj", ".ply", ".stl"};
  std::string lower = name;
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::any_of(endings.begin(), endings.end(), [&](const std::string& ending) {
    return lower.size() >= ending.size() &&
           lower.compare(lower.size() - ending.size(), ending.size(), ending) == 0;
  });
}

}  // namespace

std::string valid_utf8(const std::string& text) {
  std::string out;
  for (std::string_view rest = text; !rest.empty();) {
    const std::size_t n = utf8_length(rest);
    out += n > 0 ? rest.substr(0, n) : std::string_view("\xEF\xBF\xBD");
    rest.remove_prefix(std::max<std::size_t>(n, 1));
  }
  return out;
}

const google::protobuf::Descriptor& descriptor_of(MessageType type) {
  switch (type) {
    case MessageType::kImage:
      return *foxglove::RawImage::descriptor();
    case MessageType::kEvent:
      return *pb::Event::descriptor();
    case MessageType::kLedger:
      return *pb::LedgerEntry::descriptor();
    case MessageType::kTransform:
      return *foxglove::FrameTransform::descriptor();
    case MessageType::kPoseState:
      return *pb::PoseState::descriptor();
    case MessageType::kScan:
      return *pb::SurfaceScan::descriptor();
    case MessageType::kTransfer:
      break;
  }
  return *pb::RawTransfer::descriptor();
}

std::optional<MessageType> message_type_of(const std::string& schema_name) {
  const auto found = types_by_name().find(schema_name);
  if (found == types_by_name().end()) return std::nullopt;
  return found->second;
}

EncodedMessage encode_image(const FrameSample& frame) {
  const Image8& image = frame.image;
  foxglove::RawImage message;
  stamp(message, frame.header.capture);
  message.set_frame_id(valid_utf8(frame.header.stream));
  message.set_width(static_cast<std::uint32_t>(image.width_px));
  message.set_height(static_cast<std::uint32_t>(image.height_px));
  message.set_step(message.width());
  message.set_encoding("mono8");
  EncodedMessage encoded{message.SerializeAsString(), {}};
  if (image.pixels.empty()) return encoded;
  constexpr std::uint64_t kLengthDelimited = 2;  // wire type of `bytes`
  append_varint(encoded.head, (std::uint64_t{foxglove::RawImage::kDataFieldNumber} << 3) | kLengthDelimited);
  append_varint(encoded.head, image.pixels.size());
  encoded.body = {reinterpret_cast<const char*>(image.pixels.data()), image.pixels.size()};
  return encoded;
}

std::string encode_event(const EventSample& event) {
  pb::Event message;
  message.set_capture_ns(event.header.capture.ns);
  message.set_device_ns(event.header.device.ns);
  message.set_kind(valid_utf8(event.kind));
  message.set_pressed(event.pressed);
  message.set_text(valid_utf8(event.text));
  return message.SerializeAsString();
}

std::string encode_ledger(const LedgerSample& line, bool from_source) {
  pb::LedgerEntry entry;
  entry.set_stream(valid_utf8(line.header.stream));
  entry.set_sequence(line.header.sequence);
  entry.set_count(line.count);
  entry.set_fate(static_cast<pb::LedgerEntry::Fate>(line.fate));
  entry.set_reason(valid_utf8(line.reason));
  entry.set_capture_ns(line.header.capture.ns);
  entry.set_arrival_ns(line.header.arrival.ns);
  entry.set_device_ns(line.header.device.ns);
  entry.set_from_source(from_source && line.fate == LedgerSample::Fate::kAccepted);
  return entry.SerializeAsString();
}

std::string encode_transform(const PoseSample& pose) {
  foxglove::FrameTransform message;
  stamp(message, pose.header.capture);
  message.set_parent_frame_id(valid_utf8(pose.reference));
  message.set_child_frame_id(valid_utf8(pose.body));
  const Vector3& t = pose.reference_from_body.translation_mm;
  message.mutable_translation()->set_x(t.x());
  message.mutable_translation()->set_y(t.y());
  message.mutable_translation()->set_z(t.z());
  const Eigen::Quaterniond q(pose.reference_from_body.rotation);
  message.mutable_rotation()->set_x(q.x());
  message.mutable_rotation()->set_y(q.y());
  message.mutable_rotation()->set_z(q.z());
  message.mutable_rotation()->set_w(q.w());
  return message.SerializeAsString();
}

std::string encode_pose_state(const PoseSample& pose) {
  pb::PoseState message;
  message.set_reference(valid_utf8(pose.reference));
  message.set_body(valid_utf8(pose.body));
  message.set_valid(pose.valid);
  message.set_reason(valid_utf8(pose.reason));
  message.set_device_ns(pose.header.device.ns);
  for (int i = 0; i < 9; ++i) message.add_rotation(pose.reference_from_body.rotation(i / 3, i % 3));
  for (int i = 0; i < 3; ++i) message.add_translation_mm(pose.reference_from_body.translation_mm(i));
  return message.SerializeAsString();
}

std::vector<std::string> scan_file_order(const ScanSample& scan) {
  std::vector<std::string> names;
  for (const auto& [name, bytes] : scan.files) names.push_back(name);
  std::stable_partition(names.begin(), names.end(), is_mesh_name);
  return names;
}

std::string encode_scan(const ScanSample& scan, const std::vector<std::string>& attachments) {
  pb::SurfaceScan message;
  message.set_name(valid_utf8(scan.name));
  for (const std::string& file : scan_file_order(scan)) message.add_files(valid_utf8(file));
  for (const std::string& attachment : attachments) message.add_attachments(valid_utf8(attachment));
  message.set_sha256(valid_utf8(scan.sha256));
  message.set_deviation_mm(scan.deviation_mm);
  message.set_device_ns(scan.header.device.ns);
  return message.SerializeAsString();
}

std::string encode_transfer(const TransferSample& transfer) {
  pb::RawTransfer message;
  message.set_endpoint(transfer.endpoint);
  message.set_status(transfer.status);
  message.set_data(transfer.data);
  message.set_device_ns(transfer.header.device.ns);
  return message.SerializeAsString();
}

Result<FrameSample> decode_image(SampleHeader header, std::string_view bytes, const std::string& where) {
  foxglove::RawImage image;
  if (!parse(bytes, image)) return bad_input(kWhat, where, "an image is damaged");
  constexpr std::uint32_t kLargestSide = 65536;
  if (image.encoding() != "mono8" || image.step() != image.width() || image.width() > kLargestSide ||
      image.height() > kLargestSide || std::uint64_t{image.width()} * image.height() != image.data().size())
    return bad_input(kWhat, where,
                     fmt::format("an image of {} is {} with {} bytes; mono8 is expected", header.stream,
                                 image.encoding(), image.data().size()));
  FrameSample frame;
  frame.header = std::move(header);
  frame.image.width_px = static_cast<int>(image.width());
  frame.image.height_px = static_cast<int>(image.height());
  frame.image.pixels.assign(image.data().begin(), image.data().end());
  return frame;
}

Result<EventSample> decode_event(SampleHeader header, std::string_view bytes, const std::string& where) {
  pb::Event event;
  if (!parse(bytes, event)) return bad_input(kWhat, where, "an event is damaged");
  header.device.ns = event.device_ns();
  return EventSample{std::move(header), event.kind(), event.pressed(), event.text()};
}

Result<LedgerMessage> decode_ledger(std::string_view bytes, const std::string& where) {
  pb::LedgerEntry entry;
  if (!parse(bytes, entry) || entry.fate() < 0 || entry.fate() > 2)
    return bad_input(kWhat, where, "a ledger line is damaged");
  LedgerMessage message;
  message.line.header = {
      entry.stream(), entry.sequence(), {entry.capture_ns()}, {entry.arrival_ns()}, {entry.device_ns()}};
  message.line.count = entry.count();
  message.line.fate = static_cast<LedgerSample::Fate>(entry.fate());
  message.line.reason = entry.reason();
  message.from_source = entry.from_source();
  return message;
}

Result<PoseSample> decode_pose_state(SampleHeader header, std::string_view bytes, const std::string& where) {
  pb::PoseState state;
  if (!parse(bytes, state) || state.rotation_size() != 9 || state.translation_mm_size() != 3)
    return bad_input(kWhat, where, "a pose is damaged");
  PoseSample pose;
  pose.header = std::move(header);
  pose.header.device.ns = state.device_ns();
  pose.reference = state.reference();
  pose.body = state.body();
  pose.valid = state.valid();
  pose.reason = state.reason();
  for (int i = 0; i < 9; ++i) pose.reference_from_body.rotation(i / 3, i % 3) = state.rotation(i);
  for (int i = 0; i < 3; ++i) pose.reference_from_body.translation_mm(i) = state.translation_mm(i);
  return pose;
}

Result<ScanMessage> decode_scan(SampleHeader header, std::string_view bytes, const std::string& where) {
  pb::SurfaceScan message;
  if (!parse(bytes, message) || message.files_size() != message.attachments_size())
    return bad_input(kWhat, where, "a scan is damaged");
  ScanMessage out;
  out.scan.header = std::move(header);
  out.scan.header.device.ns = message.device_ns();
  out.scan.name = message.name();
  out.scan.sha256 = message.sha256();
  out.scan.deviation_mm = message.deviation_mm();
  for (int i = 0; i < message.files_size(); ++i)
    out.attachment_of_file[message.files(i)] = message.attachments(i);
  return out;
}

Result<TransferSample> decode_transfer(SampleHeader header, std::string_view bytes,
                                       const std::string& where) {
  pb::RawTransfer message;
  if (!parse(bytes, message) || message.endpoint() > 0xFF)
    return bad_input(kWhat, where, "a raw transfer is damaged");
  TransferSample transfer;
  transfer.header = std::move(header);
  transfer.header.device.ns = message.device_ns();
  transfer.endpoint = static_cast<std::uint8_t>(message.endpoint());
  transfer.status = message.status();
  transfer.data = message.data();
  return transfer;
}

}  // namespace gnathion
