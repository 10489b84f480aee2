// The Unix socket of the API: the daemon accepts connections itself, asks the kernel who is at the other end
// (SO_PEERCRED), and hands them to gRPC. There is no other way in: the gRPC server has no port.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "core/result.h"
#include "daemon/heartbeat.h"

namespace gnathion::daemon {

struct Peer {
  unsigned uid = 0, gid = 0;
  int pid = 0;
  std::string name;  ///< of the user, as the system knows it
  /// "uid 1000 (anna) pid 4711": for the audit trail.
  std::string who() const;
};

struct SocketOptions {
  std::filesystem::path path;
  std::string group;  ///< who may connect (mode 0660); empty: the daemon's own
  int connections = 64;
};

/// Listens from construction to destruction.
class PeerSocket {
 public:
  /// `take` gets each new connection as a non-blocking socket that it owns. Refused: a path where another
  /// daemon answers, a group that does not exist.
  static Result<std::unique_ptr<PeerSocket>> open(const SocketOptions& options,
                                                  std::function<void(int socket)> take,
                                                  Heartbeats& heartbeats);
  ~PeerSocket();
  /// Who is behind a socket that `take` got, by its number, which gRPC calls the peer ("fd:1234"). Numbers
  /// are given in turn from a wide range, so that one stands for one connection until long after its end.
  Peer peer(const std::string& grpc_peer) const;
  int connections() const;

 private:
  struct State;
  explicit PeerSocket(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace gnathion::daemon
