// Several cameras as one rig: their frames grouped into sets of one instant, each lone frame accounted for.
//
// Which frames belong together follows from the headers alone, never from when they were handed over. The
// frames that a recording keeps therefore give the same sets again, live or replayed. `recording capture`
// tells each lone frame (rig_watch.h) and keeps it; `track` groups by capture times of its own
// (tracking/session_motion.cc).
#pragma once

#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/source.h"

namespace gnathion {

struct RigSyncOptions {
  std::vector<std::string> streams;  ///< the rig's cameras, in the rig's order
  /// Frames of a set lie within this of the earliest. At most half a frame period, or sets may mix instants.
  std::int64_t tolerance_ns = 4'000'000;
  enum class TimeBase {
    kHostCapture,  ///< each camera has a clock of its own, mapped to the host's
    kDeviceTime,   ///< one clock for all (PTP, one trigger that resets the timestamps)
  } time_base = TimeBase::kHostCapture;
  /// Fewer frames than this at one instant are lone. 0: all cameras must have seen it.
  std::size_t min_frames = 0;
  /// A camera that is this much behind the others is no longer waited for, until it delivers again.
  std::int64_t max_lag_ns = 500'000'000;
  std::size_t max_waiting = 64;  ///< frames held per camera at most; beyond, its oldest is decided on
};

/// Frames of one instant. `frame[i]` is of streams[i]; null where that camera saw nothing.
struct FrameSet {
  HostTime capture;  ///< mean over the members
  std::vector<std::shared_ptr<const FrameSample>> frames;
  std::size_t count() const;
};

/// Decides which frames belong together. Pure: no clock, no thread.
class FrameGrouper {
 public:
  /// One decision: a set, or a frame without partner with its ledger line.
  struct Decision {
    FrameSet set;
    std::vector<LedgerSample> lone;      ///< rejected: "no partner within 4.0 ms"; the set is empty then
    std::vector<std::uint64_t> tickets;  ///< of the frames decided on, in the set's or the lines' order
  };
  explicit FrameGrouper(RigSyncOptions options);
  bool knows(const std::string& stream) const;
  /// Takes a frame of one of the rig's streams (in each stream in order of time; one that goes back in time
  /// is lone at once). `ticket` comes back with the decision.
  std::vector<Decision> add(std::shared_ptr<const FrameSample> frame, std::uint64_t ticket = 0);
  /// Takes the ledger's line of a rejected frame: it too tells how far its camera is. With them a recording
  /// gives the decisions of the live session again.
  std::vector<Decision> note(const LedgerSample& line);
  /// No more frames come: decides what still waits.
  std::vector<Decision> finish();

 private:
  struct Waiting {
    std::int64_t time_ns;
    std::shared_ptr<const FrameSample> frame;
    std::uint64_t ticket;
  };
  struct Stream {
    std::deque<Waiting> waiting;
    std::int64_t latest_ns = INT64_MIN;  ///< time of the newest frame so far
  };
  std::int64_t time_of(const SampleHeader& header) const;
  std::int64_t front_ns() const;
  bool advance(Stream* stream, std::int64_t t_ns, std::vector<Decision>* out);
  bool decidable(std::int64_t earliest_ns) const;
  void decide_all(bool finishing, std::vector<Decision>* out);
  Decision decide(std::int64_t at_ns);
  LedgerSample lone_line(const FrameSample& frame) const;

  RigSyncOptions options_;
  std::vector<Stream> streams_;
  std::map<std::string, std::size_t> index_;
};

/// A decorator: the frames of lone instants are replaced by their ledger lines, everything else passes as it
/// came and in the order in which it came, held back until its frames are decided (max_lag at most).
class RigSyncSource : public Source {
 public:
  RigSyncSource(Source& inner, RigSyncOptions options);
  Result<std::optional<Sample>> next() override;

 private:
  struct Slot {
    Sample sample;
    bool decided;  ///< false while a frame may still find its partners
  };
  void apply(const std::vector<FrameGrouper::Decision>& decisions);

  Source& inner_;
  FrameGrouper grouper_;
  std::deque<Slot> slots_;
  std::uint64_t first_ticket_ = 0;
  bool over_ = false;
  std::optional<Error> error_;
};

}  // namespace gnathion
