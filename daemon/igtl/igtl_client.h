// One client of the OpenIGTLink server: what it has asked for, and what still has to go out to it.
#pragma once

#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "acquisition/igtl/igtl_protocol.h"
#include "core/time.h"

namespace gnathion::daemon {

using IgtlMessage = std::shared_ptr<const std::string>;

/// The server's thread alone. Owns its socket.
class IgtlClient {
 public:
  IgtlClient(int socket, std::string name, HostTime now);
  ~IgtlClient();
  IgtlClient(const IgtlClient&) = delete;
  IgtlClient& operator=(const IgtlClient&) = delete;

  /// `key` says what it is ("TRANSFORM Jaw"): a newer one takes the place of one that has not gone out.
  void queue(const std::string& key, IgtlMessage message);
  bool wants_to_send() const { return current_ || !order_.empty(); }
  /// As much as the socket takes. False: the connection is over.
  bool send(HostTime now);
  /// Takes what has come. Not empty: why the connection is over.
  std::string receive();
  std::optional<igtl::Item> next();
  /// How long it has taken nothing although there was something.
  double stalled_s(HostTime now) const;

  int socket() const { return socket_; }
  const std::string& name() const { return name_; }

  bool wants_tdata = false;
  double tdata_interval_s = 0;
  HostTime tdata_sent;
  bool wants_splint = false;
  HostTime splint_sent;
  std::map<std::string, HostTime> status_sent;
  std::map<std::string, bool> status_valid;

 private:
  const int socket_;
  const std::string name_;
  igtl::Framer framer_;
  int nonsense_ = 0;
  std::uint64_t futile_bytes_ = 0;  ///< since the last message
  IgtlMessage current_;
  std::size_t sent_ = 0;
  HostTime progress_;
  std::deque<std::string> order_;
  std::map<std::string, IgtlMessage> waiting_;
};

}  // namespace gnathion::daemon
