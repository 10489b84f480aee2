#include "acquisition/igtl/igtl_socket.h"

#include <fmt/format.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace gnathion::igtl {

Result<TcpClient> TcpClient::create(const std::string& host, int port) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const int status = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found);
  if (status != 0)
    return bad_input("cannot look up OpenIGTLink host", host,
                     std::string(::gai_strerror(status)) + "; check the name or give its address");
  TcpClient client;
  for (const addrinfo* a = found; a; a = a->ai_next)
    client.addresses_.push_back(
        {a->ai_family, std::string(reinterpret_cast<const char*>(a->ai_addr), a->ai_addrlen)});
  ::freeaddrinfo(found);
  client.wake_ = ::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (client.wake_ < 0)
    return fail(ErrorCode::kInternal, "cannot open OpenIGTLink client", host, std::strerror(errno));
  return client;
}

TcpClient::TcpClient(TcpClient&& other) noexcept
    : addresses_(std::move(other.addresses_)),
      next_address_(other.next_address_),
      socket_(std::exchange(other.socket_, -1)),
      wake_(std::exchange(other.wake_, -1)),
      fault_(std::move(other.fault_)) {}

TcpClient::~TcpClient() {
  close();
  if (wake_ >= 0) ::close(wake_);
}

void TcpClient::close() {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

void TcpClient::wake() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const auto n = ::write(wake_, &one, sizeof one);  // full: it is awake already
}

SocketEvent TcpClient::lost(std::string why) {
  fault_ = std::move(why);
  close();
  return SocketEvent::kLost;
}

SocketEvent TcpClient::wait(short events, int timeout_ms) {
  pollfd fds[2] = {{wake_, POLLIN, 0}, {socket_, events, 0}};
  const int n = ::poll(fds, socket_ >= 0 ? 2 : 1, timeout_ms);
  if (n < 0) return errno == EINTR ? SocketEvent::kTimeout : lost(std::strerror(errno));
  if (fds[0].revents) return SocketEvent::kWoken;
  return n == 0 ? SocketEvent::kTimeout : SocketEvent::kDone;
}

SocketEvent TcpClient::pause(int timeout_ms) {
  close();
  return wait(0, timeout_ms);
}

SocketEvent TcpClient::connect(int timeout_ms) {
  close();
  const Address& address = addresses_[next_address_++ % addresses_.size()];
  socket_ = ::socket(address.family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (socket_ < 0) return lost(std::strerror(errno));
  const int on = 1;
  ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  ::setsockopt(socket_, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
  if (::connect(socket_, reinterpret_cast<const sockaddr*>(address.bytes.data()),
                static_cast<socklen_t>(address.bytes.size())) == 0)
    return SocketEvent::kDone;
  if (errno != EINPROGRESS) return lost(std::strerror(errno));
  const SocketEvent event = wait(POLLOUT, timeout_ms);
  if (event == SocketEvent::kTimeout) return lost("no answer");
  if (event != SocketEvent::kDone) {
    close();
    return event;
  }
  int error = 0;
  socklen_t size = sizeof error;
  if (::getsockopt(socket_, SOL_SOCKET, SO_ERROR, &error, &size) != 0) error = errno;
  return error == 0 ? SocketEvent::kDone : lost(std::strerror(error));
}

SocketEvent TcpClient::receive(std::string& out, int timeout_ms) {
  const SocketEvent event = wait(POLLIN, timeout_ms);
  if (event != SocketEvent::kDone) return event;
  constexpr std::size_t kMost = 256 << 10;
  const std::size_t before = out.size();
  out.resize(before + kMost);
  const ssize_t n = ::recv(socket_, out.data() + before, kMost, 0);
  out.resize(before + (n > 0 ? static_cast<std::size_t>(n) : 0));
  if (n > 0) return SocketEvent::kDone;
  if (n == 0) return lost("closed by the server");
  if (errno == EAGAIN || errno == EINTR) return SocketEvent::kTimeout;
  return lost(std::strerror(errno));
}

SocketEvent TcpClient::send(std::string_view bytes, int timeout_ms) {
  while (!bytes.empty()) {
    const ssize_t n = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (n > 0) {
      bytes.remove_prefix(static_cast<std::size_t>(n));
      continue;
    }
    if (n < 0 && errno != EAGAIN && errno != EINTR) return lost(std::strerror(errno));
    const SocketEvent event = wait(POLLOUT, timeout_ms);
    if (event == SocketEvent::kTimeout) return lost("does not take the request");
    if (event != SocketEvent::kDone) return event;
  }
  return SocketEvent::kDone;
}

}  // namespace gnathion::igtl
