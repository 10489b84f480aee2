#include "daemon/igtl/igtl_server.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <thread>

#include "acquisition/igtl/igtl_bytes.h"
#include "acquisition/igtl/igtl_writer.h"
#include "core/log.h"
#include "daemon/igtl/igtl_client.h"
#include "daemon/preview.h"

namespace gnathion::daemon {
namespace {

constexpr const char* kLoop = "igtl";
constexpr const char* kWhat = "cannot open OpenIGTLink server";
constexpr std::uint16_t kOk = 1, kNotFound = 4, kAccessDenied = 5, kNotReady = 13;
constexpr double kStatusInterval_s = 1;
constexpr double kSplintInterval_s = 1;  // a splint is read from the disk each time it is asked for
constexpr std::size_t kPosesWaiting = 8, kFramesWaiting = 4;

/// Names as Slicer shows them.
std::string device_name(const std::string& body) {
  if (body == "jaw") return "Jaw";
  if (body == "bow") return "Bow";
  if (body == "head_frame") return "HeadFrame";
  return body.substr(0, 20);
}

IgtlMessage message(const std::string& type, const std::string& device, std::string_view body,
                    HostTime time) {
  return std::make_shared<const std::string>(igtl::pack(type, device, body, igtl::timestamp_of(time)));
}

IgtlMessage status(std::uint16_t code, const std::string& device, const std::string& text, HostTime time) {
  return message("STATUS", device, igtl::status_body(code, 0, igtl::status_name(code), text), time);
}

Result<int> listening_socket(const std::string& address, int port) {
  sockaddr_in place{};
  place.sin_family = AF_INET;
  place.sin_port = htons(static_cast<std::uint16_t>(port));
  const std::string where = fmt::format("{}:{}", address, port);
  if (::inet_pton(AF_INET, address.c_str(), &place.sin_addr) != 1)
    return bad_input(kWhat, where, "the address must be an IPv4 address: 127.0.0.1, or 0.0.0.0 for all");
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&place), sizeof place) == 0 && ::listen(fd, 16) == 0)
    return fd;
  const std::string why = std::strerror(errno);
  ::close(fd);
  return bad_input(kWhat, where, why + "; choose another port in [openigtlink] of gnathiond.toml");
}

}  // namespace

struct IgtlServer::State {
  State(IgtlServerOptions o, LiveChannels& c, Heartbeats& h, Clock& k)
      : options(std::move(o)), channels(c), heartbeats(h), clock(k) {}
  void run();
  void accept_one();
  void attend(IgtlClient& client);
  void answer(IgtlClient& client, const igtl::Item& item);
  void drop(std::size_t index, const std::string& why);
  void take_poses();
  void take_frames();
  void send_poses(IgtlClient& client, const LivePoses& poses);
  void send_tdata(IgtlClient& client, const LivePoses& poses);
  void send_splint(IgtlClient& client, bool asked);
  void listen_to_frames();
  void wake_up() const {
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t n = ::write(wake, &one, sizeof one);
  }

  const IgtlServerOptions options;
  LiveChannels& channels;
  Heartbeats& heartbeats;
  Clock& clock;
  int listener = -1, wake = -1;
  std::atomic<bool> stopping{false};
  std::thread thread;
  // The server's thread alone:
  std::vector<std::unique_ptr<IgtlClient>> clients;
  std::shared_ptr<Mailbox<LivePoses>> poses;
  std::shared_ptr<Mailbox<LiveFrame>> frames;
  std::unique_ptr<PreviewChooser> chooser;
};

Result<std::unique_ptr<IgtlServer>> IgtlServer::open(const IgtlServerOptions& options, LiveChannels& channels,
                                                     Heartbeats& heartbeats, Clock& clock) {
  GNATHION_TRY(const int listener, listening_socket(options.address, options.port));
  auto state = std::make_unique<State>(options, channels, heartbeats, clock);
  state->listener = listener;
  state->wake = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  state->poses = channels.poses.subscribe(kPosesWaiting, [s = state.get()] { s->wake_up(); });
  heartbeats.begin(kLoop, 10.0);
  state->thread = std::thread([s = state.get()] { s->run(); });
  ::pthread_setname_np(state->thread.native_handle(), "igtl");
  return std::unique_ptr<IgtlServer>(new IgtlServer(std::move(state)));
}

IgtlServer::IgtlServer(std::unique_ptr<State> state) : state_(std::move(state)) {}

IgtlServer::~IgtlServer() {
  state_->stopping = true;
  state_->wake_up();
  state_->thread.join();
  // A publisher may just be calling wake_up() of a mailbox that it holds: it lets go before the file closes.
  std::weak_ptr<Mailbox<LivePoses>> poses = state_->poses;
  std::weak_ptr<Mailbox<LiveFrame>> frames = state_->frames;
  state_->poses.reset();
  state_->frames.reset();
  while (!poses.expired() || !frames.expired()) std::this_thread::yield();
  ::close(state_->listener);
  ::close(state_->wake);
  state_->heartbeats.end(kLoop);
}

int IgtlServer::port() const {
  sockaddr_in place{};
  socklen_t size = sizeof place;
  ::getsockname(state_->listener, reinterpret_cast<sockaddr*>(&place), &size);
  return ntohs(place.sin_port);
}

void IgtlServer::State::run() {
  std::vector<pollfd> waits;
  while (!stopping) {
    heartbeats.beat(kLoop);
    waits.assign({{wake, POLLIN, 0}, {listener, POLLIN, 0}});
    for (const auto& client : clients)
      waits.push_back(
          {client->socket(), static_cast<short>(POLLIN | (client->wants_to_send() ? POLLOUT : 0)), 0});
    ::poll(waits.data(), waits.size(), 500);
    std::uint64_t count = 0;
    if (waits[0].revents) [[maybe_unused]]
      const ssize_t n = ::read(wake, &count, sizeof count);
    // From the end, so that dropping one moves none that is still to be seen.
    for (std::size_t i = clients.size(); i-- > 0;) {
      const bool heard = waits[i + 2].revents & (POLLIN | POLLHUP | POLLERR);
      const std::string over = heard ? clients[i]->receive() : "";
      if (!over.empty())
        drop(i, over);
      else
        attend(*clients[i]);
    }
    if (waits[1].revents) accept_one();
    take_poses();
    take_frames();
    const HostTime now = clock.now();
    for (std::size_t i = clients.size(); i-- > 0;)
      if (!clients[i]->send(now))
        drop(i, "it has gone");
      else if (clients[i]->stalled_s(now) > options.stalled_s)
        drop(i, "it took nothing for too long");
  }
}

void IgtlServer::State::drop(std::size_t index, const std::string& why) {
  log(LogLevel::kInfo, fmt::format("OpenIGTLink: {} is let go: {}", clients[index]->name(), why));
  clients.erase(clients.begin() + static_cast<std::ptrdiff_t>(index));
  listen_to_frames();
}

/// Frames are copied for subscribers: nobody subscribes while nobody looks.
void IgtlServer::State::listen_to_frames() {
  if (clients.empty() || options.image_rate_hz <= 0) {
    frames.reset();
  } else if (!frames) {
    frames = channels.frames.subscribe(kFramesWaiting, [this] { wake_up(); });
    chooser = std::make_unique<PreviewChooser>(std::set<std::string>{}, options.image_rate_hz);
  }
}

void IgtlServer::State::accept_one() {
  sockaddr_in peer{};
  socklen_t size = sizeof peer;
  const int fd = ::accept4(listener, reinterpret_cast<sockaddr*>(&peer), &size, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (fd < 0) return;
  char text[INET_ADDRSTRLEN] = {};
  ::inet_ntop(AF_INET, &peer.sin_addr, text, sizeof text);
  const std::string name = fmt::format("{}:{}", text, ntohs(peer.sin_port));
  if (static_cast<int>(clients.size()) >= options.clients) {
    ::close(fd);
    log(LogLevel::kWarning,
        fmt::format("OpenIGTLink: {} is refused: {} clients are there", name, options.clients));
    return;
  }
  const int on = 1, buffer = 256 << 10;  // newest-only means little behind a buffer of megabytes
  ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  ::setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &buffer, sizeof buffer);
  log(LogLevel::kInfo, fmt::format("OpenIGTLink: {} reads from now on", name));
  clients.push_back(std::make_unique<IgtlClient>(fd, name, clock.now()));
  // The surface first: the library's PolyDataClient takes the first message for its answer.
  send_splint(*clients.back(), false);
  clients.back()->queue("STATUS Gnathion", status(kOk, "Gnathion", "read-only", clock.now()));
  listen_to_frames();
}

void IgtlServer::State::attend(IgtlClient& client) {
  while (const auto item = client.next())
    if (item->kind == igtl::Item::Kind::kMessage) answer(client, *item);
  // However often it asks: reading a splint must not keep the others waiting.
  if (client.wants_splint && clock.now().seconds_since(client.splint_sent) >= kSplintInterval_s)
    send_splint(client, true);
}

void IgtlServer::State::answer(IgtlClient& client, const igtl::Item& item) {
  const std::string& type = item.header.type;
  const HostTime now = clock.now();
  if (type == "STT_TDATA") {
    client.wants_tdata = true;
    const auto content = igtl::content_of(item.header, item.body);
    const std::uint32_t ms = content && content->bytes.size() >= 4 ? igtl::u32(content->bytes, 0) : 0;
    client.tdata_interval_s = 1e-3 * std::min(ms, 60'000u);
    client.queue("RTS_TDATA", message("RTS_TDATA", "Gnathion", igtl::tracking_reply_body(true), now));
  } else if (type == "STP_TDATA") {
    client.wants_tdata = false;
    client.queue("RTS_TDATA", message("RTS_TDATA", "Gnathion", igtl::tracking_reply_body(true), now));
  } else if (type == "GET_POLYDATA") {
    client.wants_splint = true;
  } else if (type == "GET_STATUS") {
    client.queue("STATUS Gnathion", status(kOk, "Gnathion", "read-only", now));
  } else if (type.rfind("GET_", 0) != 0) {
    client.queue("STATUS Gnathion",
                 status(kAccessDenied, "Gnathion", "this server is read-only: " + type, now));
  }  // other requests are met by what goes out unasked
}

void IgtlServer::State::send_splint(IgtlClient& client, bool asked) {
  const std::shared_ptr<const TriangleMesh> splint = options.splint ? options.splint() : nullptr;
  const HostTime now = clock.now();
  if (asked) {
    client.wants_splint = false;
    client.splint_sent = now;
  }
  if (splint)
    client.queue("POLYDATA Splint", message("POLYDATA", "Splint", igtl::polydata_body(*splint), now));
  else if (asked)
    client.queue("STATUS Splint", status(kNotFound, "Splint", "the session's case has no splint yet", now));
}

void IgtlServer::State::send_tdata(IgtlClient& client, const LivePoses& live) {
  if (live.published.seconds_since(client.tdata_sent) < client.tdata_interval_s - 0.002) return;
  std::vector<igtl::ToolPose> tools;
  for (const LivePose& pose : live.poses)
    if (pose.valid) tools.push_back({device_name(pose.body), pose.reference_from_body, false, {}});
  if (tools.empty()) return;
  client.tdata_sent = live.published;
  client.queue("TDATA", message("TDATA", "Gnathion", igtl::tdata_body(tools), live.capture));
}

void IgtlServer::State::send_poses(IgtlClient& client, const LivePoses& live) {
  for (const LivePose& pose : live.poses) {
    const std::string name = device_name(pose.body);
    if (pose.valid)
      client.queue("TRANSFORM " + name,
                   message("TRANSFORM", name, igtl::transform_body(pose.reference_from_body), live.capture));
    const auto told = client.status_sent.find(name);
    const bool due = told == client.status_sent.end() || client.status_valid[name] != pose.valid ||
                     live.published.seconds_since(told->second) >= kStatusInterval_s;
    if (!due) continue;
    client.status_sent[name] = live.published;
    client.status_valid[name] = pose.valid;
    client.queue("STATUS " + name, status(pose.valid ? kOk : kNotReady, name,
                                          pose.valid ? "in " + pose.reference : pose.reason, live.capture));
  }
  if (client.wants_tdata) send_tdata(client, live);
}

/// What waited when the loop woke up, and no more: instruments faster than this loop must not keep it here.
/// Whatever comes meanwhile wakes it up again.
void IgtlServer::State::take_poses() {
  for (std::size_t i = 0; i < kPosesWaiting; ++i) {
    const auto mail = poses->take_within(std::chrono::nanoseconds(0));
    if (!mail) return;
    for (const auto& client : clients) send_poses(*client, *mail->value);
  }
}

void IgtlServer::State::take_frames() {
  if (!frames) return;
  for (std::size_t i = 0; i < kFramesWaiting; ++i) {
    const auto mail = frames->take_within(std::chrono::nanoseconds(0));
    if (!mail) return;
    if (!chooser->take(*mail->value, mail->missed)) continue;
    const SampleHeader& header = mail->value->frame.header;
    const Image8 small = shrunk(mail->value->frame.image, options.image_width_px);
    const IgtlMessage image =
        message("IMAGE", header.stream.substr(0, 20), igtl::image_body(small), header.capture);
    for (const auto& client : clients) client->queue("IMAGE " + header.stream, image);
  }
}

}  // namespace gnathion::daemon
