// A TCP server on a free port of this machine whose behaviour a test writes.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <functional>
#include <string>
#include <string_view>
#include <thread>

#include "core/check.h"

namespace gnathion {

/// One client at a time. `serve` gets the connected socket and its number (from 0); the socket is closed when
/// it returns.
class Peer {
 public:
  class Connection {
   public:
    Connection(int fd, const std::atomic<bool>& over) : fd_(fd), over_(over) {}
    /// False once the client has gone.
    bool send(std::string_view bytes) const {
      while (!bytes.empty() && !over_) {
        const ssize_t n = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
        if (n <= 0) return false;
        bytes.remove_prefix(static_cast<std::size_t>(n));
      }
      return !over_;
    }
    /// What the client sends, until `count` bytes are there or it has gone.
    std::string receive(std::size_t count) const {
      std::string bytes;
      char buffer[256];
      while (bytes.size() < count && wait_readable()) {
        const ssize_t n = ::recv(fd_, buffer, std::min(sizeof buffer, count - bytes.size()), 0);
        if (n <= 0) break;
        bytes.append(buffer, static_cast<std::size_t>(n));
      }
      return bytes;
    }
    /// Waits until the client closes or the test is over.
    void hold() const {
      char c;
      while (wait_readable())
        if (::recv(fd_, &c, 1, 0) <= 0) return;
    }
    bool over() const { return over_; }

   private:
    bool wait_readable() const {
      while (!over_) {
        pollfd p{fd_, POLLIN, 0};
        if (::poll(&p, 1, 20) > 0) return true;
      }
      return false;
    }
    int fd_;
    const std::atomic<bool>& over_;
  };

  explicit Peer(std::function<void(const Connection&, int)> serve) : serve_(std::move(serve)) {
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    GNATHION_CHECK(::bind(listener_, reinterpret_cast<sockaddr*>(&address), size) == 0);
    GNATHION_CHECK(::listen(listener_, 8) == 0);
    GNATHION_CHECK(::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) == 0);
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this] { run(); });
  }
  ~Peer() {
    over_ = true;
    thread_.join();
    ::close(listener_);
  }
  int port() const { return port_; }
  int connections() const { return connections_; }

 private:
  void run() {
    while (!over_) {
      pollfd p{listener_, POLLIN, 0};
      if (::poll(&p, 1, 20) <= 0) continue;
      const int fd = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (fd < 0) continue;
      serve_(Connection(fd, over_), connections_++);
      ::close(fd);
    }
  }
  std::function<void(const Connection&, int)> serve_;
  int listener_ = -1, port_ = 0;
  std::atomic<bool> over_ = false;
  std::atomic<int> connections_ = 0;
  std::thread thread_;
};

}  // namespace gnathion
