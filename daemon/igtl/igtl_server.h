// The live jaw for 3D Slicer, PLUS and whoever speaks OpenIGTLink. Read-only: what clients send beside
// requests is refused. A client that reads slowly gets the newest of each kind; one that reads nothing for 10
// s is let go.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "core/mesh.h"
#include "core/result.h"
#include "daemon/heartbeat.h"
#include "daemon/live_types.h"

namespace gnathion::daemon {

struct IgtlServerOptions {
  std::string address = "127.0.0.1";
  int port = 18944;  ///< 0: any that is free
  int clients = 8;
  double image_rate_hz = 10;
  int image_width_px = 640;
  double stalled_s = 10;  ///< a client that takes nothing for so long is let go
  /// The splint of the session's case, when there is one. Called in the server's thread when a client asks or
  /// comes.
  std::function<std::shared_ptr<const TriangleMesh>()> splint;
};

/// What is sent:
///   TRANSFORM "Jaw", "Bow", "HeadFrame" (and sensors under their names), each valid pose, unasked;
///   STATUS of the same names: 1 while the pose is valid, 13 (not ready) with the reason while it is not; at
///     every change and once a second;
///   TDATA "Gnathion" with all valid ones, between STT_TDATA and STP_TDATA, at most as often as asked;
///   IMAGE by the camera's stream name; POLYDATA "Splint" on connection and at GET_POLYDATA, once a second.
class IgtlServer {
 public:
  static Result<std::unique_ptr<IgtlServer>> open(const IgtlServerOptions& options, LiveChannels& channels,
                                                  Heartbeats& heartbeats, Clock& clock);
  ~IgtlServer();
  int port() const;

 private:
  struct State;
  explicit IgtlServer(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace gnathion::daemon
