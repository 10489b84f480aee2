// A TCP client that never blocks longer than it is told and can be woken from another thread.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace gnathion::igtl {

enum class SocketEvent : std::uint8_t {
  kDone,     ///< connected, or bytes came
  kTimeout,  ///< nothing happened in time
  kLost,     ///< refused, closed or broken: see fault()
  kWoken,    ///< by wake()
};

/// One thread at a time, but for wake().
class TcpClient {
 public:
  /// Looks the host up, once; refuses what is not known.
  static Result<TcpClient> create(const std::string& host, int port);
  TcpClient(TcpClient&& other) noexcept;
  TcpClient& operator=(TcpClient&&) = delete;
  ~TcpClient();

  SocketEvent connect(int timeout_ms);
  /// Appends what is there, 256 KiB at most.
  SocketEvent receive(std::string& out, int timeout_ms);
  SocketEvent send(std::string_view bytes, int timeout_ms);
  /// Waits without a connection.
  SocketEvent pause(int timeout_ms);
  void close();
  bool connected() const { return socket_ >= 0; }
  const std::string& fault() const { return fault_; }
  /// Every wait ends now and from now on. Any thread.
  void wake();

 private:
  TcpClient() = default;
  SocketEvent wait(short events, int timeout_ms);
  SocketEvent lost(std::string why);
  struct Address {
    int family = 0;
    std::string bytes;  ///< a sockaddr
  };
  std::vector<Address> addresses_;
  std::size_t next_address_ = 0;
  int socket_ = -1, wake_ = -1;
  std::string fault_;
};

}  // namespace gnathion::igtl
