// From OpenIGTLink messages to samples: streams, counters, times, validity. The state of one peer, without
// its connection.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "acquisition/clock_estimator.h"
#include "acquisition/igtl/igtl_messages.h"
#include "acquisition/igtl/igtl_protocol.h"
#include "core/sample.h"

namespace gnathion::igtl {

/// Whose counter the message numbers of protocol 2 and later are.
enum class MessageIds : std::uint8_t { kStream, kConnection, kIgnore };

/// One thread at a time.
class Translator {
 public:
  struct Options {
    std::string name;                   ///< of the device: first part of every stream
    std::string reference = "tracker";  ///< what poses are given in where the message does not say
    MessageIds message_ids = MessageIds::kStream;
    std::int64_t latency_ns = 0;
    DecodeOptions decoding;
    std::size_t max_streams = 256;  ///< a peer that invents names without end is cut short
  };
  explicit Translator(Options options);

  /// A new connection: counters and STATUS start anew, the clock and the names of streams stay.
  void on_connect();
  /// What the item means, in order: first what is missing before it, then itself.
  std::vector<Sample> take(const Item& item, HostTime arrival);
  const ClockEstimate& clock() const { return clock_.estimate(); }
  /// Messages of types that are not read, by type.
  const std::map<std::string, std::uint64_t>& other_types() const { return other_types_; }

 private:
  /// A stream of samples: its name and its last counter.
  struct Stream {
    std::string name, body, reference;
    std::uint32_t sequence = 0;  ///< the next, where the messages carry none
  };
  /// Messages of one type from one device.
  struct Channel {
    std::vector<std::string> streams;  ///< keys; a tracker's message has one for each tool
    std::optional<std::uint32_t> id;   ///< the last, where messages are numbered
    std::uint64_t timestamp = 0, crc = 0;
    std::uint32_t unread = 0;  ///< messages since `id` that came damaged, their numbers unknown
    bool any = false;
  };
  /// One message on its way.
  struct Incoming {
    const Header& header;
    HostTime arrival, capture;
    std::uint32_t id = 0;  ///< 0: not numbered
    std::map<std::string, std::string> metadata;
    std::vector<Sample>& out;
  };

  void take_message(const Item& item, HostTime arrival, std::vector<Sample>& out);
  void take_rejected(const Item& item, HostTime arrival, std::vector<Sample>& out);
  void reject_message(Channel& channel, const Incoming& in, const std::string& reason);
  bool in_order(Channel& channel, const Incoming& in);
  void count_gap(Channel& channel, const Incoming& in);
  HostTime capture_time(const Header& header, HostTime arrival);

  void take_poses(Channel& channel, const Incoming& in, const Poses& poses);
  void take_picture(Channel& channel, const Incoming& in, Picture picture);
  void take_mesh(Channel& channel, const Incoming& in, const TriangleMesh& mesh);
  void take_state(Channel& channel, const Incoming& in, const State& state);
  std::string fault_of(const Incoming& in, const std::string& tool) const;

  Stream* stream(Channel& channel, const Incoming& in, const std::string& tool, const std::string& suffix);
  SampleHeader header_for(Stream& stream, const Incoming& in);
  void reject(const std::string& stream, std::uint32_t sequence, const Incoming& in, std::string reason);

  Options options_;
  ClockEstimator clock_;
  std::optional<DeviceTime> newest_;
  HostTime newest_host_;
  std::map<std::string, Channel> channels_;        ///< by type and device
  std::map<std::string, Stream> streams_;          ///< by type, device and tool
  std::set<std::string> names_;                    ///< of streams, taken
  std::map<std::string, std::string> bad_states_;  ///< by device: what its last STATUS said
  std::optional<std::uint32_t> connection_id_;
  std::uint32_t connection_unread_ = 0;
  std::uint32_t unplaced_ = 0;  ///< counter of ledger lines that belong to no stream
  std::map<std::string, std::uint64_t> other_types_;
};

}  // namespace gnathion::igtl
