#include "daemon/peers.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <grp.h>
#include <poll.h>
#include <pthread.h>
#include <pwd.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <cstring>
#include <map>
#include <mutex>
#include <thread>
#include <vector>

#include "core/log.h"

namespace gnathion::daemon {
namespace {

namespace fs = std::filesystem;
constexpr const char* kLoop = "accept";
constexpr const char* kWhat = "cannot listen";
/// Sockets of clients have numbers of their own; other files of the process are below.
constexpr int kFirstNumber = 4096;

std::string user_name(unsigned uid) {
  passwd entry{}, *found = nullptr;
  char buffer[4096];
  return ::getpwuid_r(uid, &entry, buffer, sizeof buffer, &found) == 0 && found ? found->pw_name : "";
}

sockaddr_un address_of(const fs::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
  return address;
}

bool somebody_answers(const fs::path& path) {
  const int probe = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_un address = address_of(path);
  const bool answers = ::connect(probe, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  ::close(probe);
  return answers;
}

/// So that numbers may be as large as the hard limit lets them be.
int raise_file_limit() {
  rlimit limit{};
  ::getrlimit(RLIMIT_NOFILE, &limit);
  limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, 1 << 20);
  ::setrlimit(RLIMIT_NOFILE, &limit);
  ::getrlimit(RLIMIT_NOFILE, &limit);
  return static_cast<int>(std::min<rlim_t>(limit.rlim_cur, 1 << 20));
}

Result<int> listening_socket(const SocketOptions& options) {
  std::error_code ec;
  if (fs::exists(options.path, ec)) {
    if (!fs::is_socket(options.path, ec))
      return bad_input(kWhat, options.path.string(), "is not a socket; remove it or choose another path");
    if (somebody_answers(options.path))
      return bad_input(kWhat, options.path.string(), "another gnathiond answers there; stop it first");
    fs::remove(options.path, ec);  // of a daemon that was killed
  }
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const sockaddr_un address = address_of(options.path);
  const mode_t before = ::umask(0777);  // nobody, until the group is set
  const bool bound = ::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  ::umask(before);
  const auto give_up = [&](const std::string& why) {
    ::close(fd);
    return bad_input(kWhat, options.path.string(), why);
  };
  if (!bound) return give_up(std::strerror(errno));
  if (!options.group.empty()) {
    const group* entry = ::getgrnam(options.group.c_str());
    if (!entry) return give_up(fmt::format("there is no group '{}'; groupadd --system it", options.group));
    if (::chown(options.path.c_str(), static_cast<uid_t>(-1), entry->gr_gid) != 0)
      return give_up(fmt::format("cannot give it to group '{}': {}", options.group, std::strerror(errno)));
  }
  if (::chmod(options.path.c_str(), 0660) != 0 || ::listen(fd, 64) != 0) return give_up(std::strerror(errno));
  return fd;
}

}  // namespace

std::string Peer::who() const {
  return fmt::format("uid {}{} pid {}", uid, name.empty() ? "" : fmt::format(" ({})", name), pid);
}

struct PeerSocket::State {
  State(SocketOptions o, std::function<void(int)> t, Heartbeats& h)
      : options(std::move(o)), take(std::move(t)), heartbeats(h) {}
  void run();
  void accept_one();
  void forget_closed();
  int number_for(int socket);

  const SocketOptions options;
  const std::function<void(int)> take;
  Heartbeats& heartbeats;
  int listener = -1, wake = -1, last_number = 0;
  int next_number = kFirstNumber;
  std::thread thread;
  mutable std::mutex mutex;
  std::map<int, Peer> peers;  ///< under mutex; by number
};

Result<std::unique_ptr<PeerSocket>> PeerSocket::open(const SocketOptions& options,
                                                     std::function<void(int)> take, Heartbeats& heartbeats) {
  GNATHION_TRY(const int listener, listening_socket(options));
  auto state = std::make_unique<State>(options, std::move(take), heartbeats);
  state->listener = listener;
  state->wake = ::eventfd(0, EFD_CLOEXEC);
  state->last_number = raise_file_limit();
  if (state->last_number < 2 * kFirstNumber) {
    ::close(listener);
    return bad_input(
        kWhat, "limit of open files",
        fmt::format("is {}; raise it to {} (LimitNOFILE=)", state->last_number, 2 * kFirstNumber));
  }
  heartbeats.begin(kLoop, 5.0);
  state->thread = std::thread([s = state.get()] { s->run(); });
  ::pthread_setname_np(state->thread.native_handle(), "accept");
  return std::unique_ptr<PeerSocket>(new PeerSocket(std::move(state)));
}

PeerSocket::PeerSocket(std::unique_ptr<State> state) : state_(std::move(state)) {}

PeerSocket::~PeerSocket() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = ::write(state_->wake, &one, sizeof one);
  state_->thread.join();
  ::close(state_->listener);
  ::close(state_->wake);
  std::error_code ec;
  fs::remove(state_->options.path, ec);
  state_->heartbeats.end(kLoop);
}

/// gRPC closes a connection's socket when it ends: its number is free then, and nobody else takes numbers
/// from this range.
void PeerSocket::State::forget_closed() {
  std::lock_guard lock(mutex);
  std::erase_if(peers, [](const auto& entry) { return ::fcntl(entry.first, F_GETFD) < 0; });
}

/// The next free number, in turn.
int PeerSocket::State::number_for(int socket) {
  if (next_number >= last_number - 64) next_number = kFirstNumber;
  const int number = ::fcntl(socket, F_DUPFD_CLOEXEC, next_number);
  if (number >= 0) next_number = number + 1;
  return number;
}

void PeerSocket::State::accept_one() {
  const int socket = ::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (socket < 0) return;
  forget_closed();
  ucred credentials{};
  socklen_t size = sizeof credentials;
  const bool known = ::getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &credentials, &size) == 0;
  std::unique_lock lock(mutex);
  const bool room = static_cast<int>(peers.size()) < options.connections;
  const int number = known && room ? number_for(socket) : -1;
  ::close(socket);
  if (number < 0) {
    lock.unlock();
    log(LogLevel::kWarning, room ? "a connection was refused: nobody knows whose it is"
                                 : fmt::format("a connection was refused: {} are open (limits.connections)",
                                               options.connections));
    return;
  }
  peers[number] = {credentials.uid, credentials.gid, credentials.pid, user_name(credentials.uid)};
  lock.unlock();
  take(number);
}

void PeerSocket::State::run() {
  while (true) {
    heartbeats.beat(kLoop);
    pollfd waits[2] = {{listener, POLLIN, 0}, {wake, POLLIN, 0}};
    if (::poll(waits, 2, 1000) < 0 && errno != EINTR) return;
    if (waits[1].revents) return;
    if (waits[0].revents) accept_one();
  }
}

Peer PeerSocket::peer(const std::string& grpc_peer) const {
  if (grpc_peer.rfind("fd:", 0) != 0) return {};
  std::lock_guard lock(state_->mutex);
  const auto found = state_->peers.find(std::atoi(grpc_peer.c_str() + 3));
  return found == state_->peers.end()
             ? Peer{static_cast<unsigned>(-1), static_cast<unsigned>(-1), 0, "unknown"}
             : found->second;
}

int PeerSocket::connections() const {
  std::lock_guard lock(state_->mutex);
  int open = 0;
  for (const auto& [number, peer] : state_->peers) open += ::fcntl(number, F_GETFD) >= 0;
  return open;
}

}  // namespace gnathion::daemon
