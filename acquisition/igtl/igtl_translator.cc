#include "acquisition/igtl/igtl_translator.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "acquisition/exchange/plus_names.h"
#include "core/file.h"
#include "core/mesh_io.h"

namespace gnathion::igtl {
namespace {

/// A sender that starts again sends old times or low numbers; one that mixes up its messages stays near.
constexpr std::uint64_t kReorderSpan = std::uint64_t{5} << 32;  // 5 s in 32.32
constexpr std::uint32_t kReorderIds = 64;

/// Stream names are letters, digits, '_' and '-'.
std::string segment(const std::string& name) {
  std::string s = name.empty() ? "unnamed" : name;
  for (char& c : s)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-') c = '_';
  if (s == "state" || s == "raw") s += '_';  // these two are the device's own
  return s;
}

bool says_no(const std::string& value) {
  std::string lower;
  for (const char c : value) lower += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return lower == "false" || lower == "0";
}

}  // namespace

Translator::Translator(Options options)
    : options_(std::move(options)), clock_({.latency_ns = options_.latency_ns}) {}

void Translator::on_connect() {
  for (auto& [key, channel] : channels_) {
    const auto streams = std::move(channel.streams);
    channel = Channel{};
    channel.streams = streams;
  }
  bad_states_.clear();
  connection_id_.reset();
  connection_unread_ = 0;
}

std::vector<Sample> Translator::take(const Item& item, HostTime arrival) {
  std::vector<Sample> out;
  if (item.kind == Item::Kind::kRejected)
    take_rejected(item, arrival, out);
  else
    take_message(item, arrival, out);
  return out;
}

void Translator::reject(const std::string& stream, std::uint32_t sequence, const Incoming& in,
                        std::string reason) {
  LedgerSample line;
  line.header = {stream, sequence, in.capture, in.arrival, {in.header.timestamp_ns()}};
  line.fate = LedgerSample::Fate::kRejected;
  line.reason = std::move(reason);
  in.out.push_back(std::move(line));
}

void Translator::take_rejected(const Item& item, HostTime arrival, std::vector<Sample>& out) {
  Incoming in{item.header, arrival, arrival, 0, {}, out};
  const auto found = channels_.find(item.header.type + "/" + item.header.device);
  if (found == channels_.end() || found->second.streams.empty()) {
    reject(options_.name, unplaced_++, in, item.reason);
    return;
  }
  // The header is not covered by the checksum, but it names a stream that is there.
  Channel& channel = found->second;
  const bool numbered = channel.id && options_.message_ids == MessageIds::kStream;
  for (const std::string& key : channel.streams) {
    Stream& s = streams_.at(key);
    reject(s.name, numbered ? *channel.id + 1 + channel.unread : s.sequence++, in, item.reason);
  }
  ++channel.unread;
  ++connection_unread_;
}

/// A message whose number, if it has one, is known.
void Translator::reject_message(Channel& channel, const Incoming& in, const std::string& reason) {
  if (channel.streams.empty()) reject(options_.name, unplaced_++, in, reason);
  for (const std::string& key : channel.streams) {
    Stream& s = streams_.at(key);
    reject(s.name, header_for(s, in).sequence, in, reason);
  }
}

HostTime Translator::capture_time(const Header& header, HostTime arrival) {
  if (header.timestamp == 0) return {arrival.ns - options_.latency_ns};
  const DeviceTime device{header.timestamp_ns()};
  if (newest_ && device == *newest_) return newest_host_;
  constexpr std::int64_t kReset_ns = 5'000'000'000;
  if (newest_ && device < *newest_ && newest_->ns - device.ns < kReset_ns)
    return clock_.host_from_device(device).value_or(HostTime{arrival.ns - options_.latency_ns});
  newest_ = device;
  newest_host_ = clock_.add(device, arrival);
  return newest_host_;
}

void Translator::take_message(const Item& item, HostTime arrival, std::vector<Sample>& out) {
  const Header& header = item.header;
  Incoming in{header, arrival, arrival, 0, {}, out};
  if (!is_read(header.type)) {
    ++other_types_[other_types_.size() < options_.max_streams ? header.type : "others"];
    reject(options_.name, unplaced_++, in, fmt::format("type {} is not read", header.type));
    return;
  }
  const std::string key = header.type + "/" + header.device;
  if (!channels_.count(key) && channels_.size() >= options_.max_streams) {
    reject(options_.name, unplaced_++, in, fmt::format("more than {} devices", options_.max_streams));
    return;
  }
  Channel& channel = channels_[key];
  in.capture = capture_time(header, arrival);
  auto content = content_of(header, item.body);
  if (!content) {
    take_rejected({Item::Kind::kRejected, header, {}, content.error().why}, arrival, out);
    return;
  }
  if (options_.message_ids != MessageIds::kIgnore) in.id = content->message_id;
  in.metadata = std::move(content->metadata);
  if (!in_order(channel, in)) return;
  count_gap(channel, in);
  auto body = decode(header.type, content->bytes, options_.decoding);
  if (!body) {
    reject_message(channel, in, body.error().why);
  } else if (const auto* poses = std::get_if<Poses>(&*body)) {
    take_poses(channel, in, *poses);
  } else if (auto* picture = std::get_if<Picture>(&*body)) {
    take_picture(channel, in, std::move(*picture));
  } else if (const auto* mesh = std::get_if<TriangleMesh>(&*body)) {
    take_mesh(channel, in, *mesh);
  } else {
    take_state(channel, in, std::get<State>(*body));
  }
}

/// False: the message repeats the last one or is older; it is in the ledger then.
bool Translator::in_order(Channel& channel, const Incoming& in) {
  const Header& h = in.header;
  std::string fault;
  const bool numbered = in.id != 0 && channel.id;
  if (channel.any && h.timestamp == channel.timestamp && h.crc == channel.crc &&
      (h.timestamp != 0 || (numbered && in.id == *channel.id)))
    fault = "duplicate";
  else if (h.timestamp != 0 && h.timestamp < channel.timestamp &&
           channel.timestamp - h.timestamp < kReorderSpan)
    fault = "out of order";
  else if (h.timestamp == 0 && numbered && in.id < *channel.id && *channel.id - in.id <= kReorderIds)
    fault = "out of order";
  if (fault.empty()) {
    channel.any = true;
    channel.timestamp = h.timestamp;
    channel.crc = h.crc;
    return true;
  }
  reject_message(channel, in, fault);
  return false;
}

/// Tells the messages whose numbers are left out, less those that came but could not be read.
void Translator::count_gap(Channel& channel, const Incoming& in) {
  if (in.id == 0) return;
  const bool by_connection = options_.message_ids == MessageIds::kConnection;
  const std::optional<std::uint32_t> last = by_connection ? connection_id_ : channel.id;
  const std::uint32_t unread = by_connection ? connection_unread_ : channel.unread;
  channel.id = connection_id_ = in.id;
  channel.unread = connection_unread_ = 0;
  // Not onward: the first one, or the sender started again.
  const std::uint32_t gap = last && in.id > *last ? in.id - *last - 1 : 0;
  if (gap <= unread) return;
  LedgerSample line;
  line.header = {options_.name, *last + 1 + unread, in.capture, in.arrival, {in.header.timestamp_ns()}};
  line.fate = LedgerSample::Fate::kMissing;
  line.count = gap - unread;
  line.reason = "message number gap";
  if (by_connection || channel.streams.empty()) {
    in.out.push_back(line);
    return;
  }
  for (const std::string& key : channel.streams) {
    line.header.stream = streams_.at(key).name;
    in.out.push_back(line);
  }
}

/// The stream of a message's device, or of one of its tools; nothing when there are too many.
Translator::Stream* Translator::stream(Channel& channel, const Incoming& in, const std::string& tool,
                                       const std::string& suffix) {
  const std::string key = in.header.type + "/" + in.header.device + "/" + tool;
  const auto found = streams_.find(key);
  if (found != streams_.end()) return &found->second;
  if (streams_.size() >= options_.max_streams) {
    reject(options_.name, unplaced_++, in, fmt::format("more than {} streams", options_.max_streams));
    return nullptr;
  }
  const std::string base = options_.name + "/" + segment(tool.empty() ? in.header.device : tool);
  Stream s;
  s.name = base + suffix;
  for (int n = 2; !names_.insert(s.name).second; ++n) s.name = fmt::format("{}_{}{}", base, n, suffix);
  const PlusNames names = split_transform_name(in.header.device);
  const bool named = names.from != in.header.device;
  if (!tool.empty()) {
    s.body = tool;
    s.reference = in.header.device.empty() ? options_.reference : in.header.device;
  } else {
    s.body = names.from;
    s.reference = named ? names.to : options_.reference;
  }
  channel.streams.push_back(key);
  return &(streams_[key] = std::move(s));
}

SampleHeader Translator::header_for(Stream& s, const Incoming& in) {
  const bool numbered = in.id != 0 && options_.message_ids == MessageIds::kStream;
  const std::uint32_t sequence = numbered ? in.id : s.sequence++;
  return {s.name, sequence, in.capture, in.arrival, {in.header.timestamp_ns()}};
}

/// Why a pose is not to be trusted although its numbers are sound; empty: it is.
std::string Translator::fault_of(const Incoming& in, const std::string& tool) const {
  for (const std::string& name : {in.header.device, tool})
    if (const auto bad = bad_states_.find(name); bad != bad_states_.end()) return bad->second;
  for (const char* key : {"TransformStatus", "Status"})
    if (const auto m = in.metadata.find(key); m != in.metadata.end() && m->second != "OK") return m->second;
  if (const auto m = in.metadata.find("TransformValid"); m != in.metadata.end() && says_no(m->second))
    return "sender says invalid";
  return {};
}

void Translator::take_poses(Channel& channel, const Incoming& in, const Poses& poses) {
  std::vector<std::string> unseen = channel.streams;
  for (const ToolPose& tool : poses.tools) {
    Stream* s = stream(channel, in, tool.name, "");
    if (!s) continue;
    const std::string key = in.header.type + "/" + in.header.device + "/" + tool.name;
    unseen.erase(std::remove(unseen.begin(), unseen.end(), key), unseen.end());
    const SampleHeader header = header_for(*s, in);
    if (!tool.fault.empty()) {
      reject(s->name, header.sequence, in, tool.fault);
      continue;
    }
    PoseSample pose{header, s->reference, s->body, true, {}, tool.reference_from_tool};
    pose.reason = tool.position_only ? "position only" : fault_of(in, tool.name);
    pose.valid = pose.reason.empty();
    in.out.push_back(std::move(pose));
  }
  // A tracker leaves out the tools that it does not see.
  for (const std::string& key : unseen) {
    Stream& s = streams_.at(key);
    in.out.push_back(PoseSample{header_for(s, in), s.reference, s.body, false, "not in the message", {}});
  }
}

void Translator::take_picture(Channel& channel, const Incoming& in, Picture picture) {
  if (Stream* s = stream(channel, in, "", "/image"))
    in.out.push_back(FrameSample{header_for(*s, in), std::move(picture.image)});
}

void Translator::take_mesh(Channel& channel, const Incoming& in, const TriangleMesh& mesh) {
  Stream* s = stream(channel, in, "", "/scan");
  if (!s) return;
  ScanSample scan;
  scan.header = header_for(*s, in);
  scan.name = fmt::format("{}_{:06}.ply", segment(in.header.device), scan.header.sequence);
  std::string bytes = format_mesh(mesh, MeshFormat::kPlyBinary);
  scan.sha256 = sha256_hex(bytes);
  scan.files[scan.name] = std::move(bytes);
  in.out.push_back(std::move(scan));
}

void Translator::take_state(Channel& channel, const Incoming& in, const State& state) {
  std::string text = status_name(state.code);
  if (!state.name.empty()) text += " (" + state.name + ")";
  if (!state.text.empty()) text += ": " + state.text;
  if (state.good())
    bad_states_.erase(in.header.device);
  else
    bad_states_[in.header.device] = "status: " + status_name(state.code);
  if (Stream* s = stream(channel, in, "", "/status"))
    in.out.push_back(EventSample{header_for(*s, in), "status", state.good(), std::move(text)});
}

}  // namespace gnathion::igtl
