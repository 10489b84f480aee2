// A whole session: every frame of a source becomes a row of poses, valid or with the reason why not.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "core/camera_model.h"
#include "core/progress.h"
#include "core/source.h"
#include "core/transform.h"
#include "tracking/body_tracker.h"

namespace gnathion {

/// One instant of the rig. Frames that never came have a row, too: both poses invalid, reason "missing: …".
struct MotionRow {
  std::uint32_t sequence = 0;  ///< counter of the rig's first camera that was there
  HostTime capture;            ///< mid-exposure; interpolated for missing frames
  int cameras = 0;             ///< how many cameras delivered
  BodyPose bow, head;

  bool valid() const { return bow.valid && head.valid; }
  std::string reason() const;  ///< "" or "bow: no tag seen; head: …"
  /// The bow in the head frame, H⁻¹·M: the head's own motion is out of it. For valid rows.
  Transform<HeadFrame, Bow> head_from_bow() const;
  /// Covariance of its left perturbation; the two bodies' errors are taken as independent.
  Matrix6 head_from_bow_covariance() const;
};

/// What became of one stream's frames.
struct StreamLedger {
  std::size_t frames = 0;    ///< tracked
  std::size_t missing = 0;   ///< counter gaps, or told by the source
  std::size_t rejected = 0;  ///< delivered to the host, but refused
  std::size_t ignored = 0;   ///< frames of a stream that the rig does not know
};

struct SessionMotion {
  std::vector<MotionRow> rows;      ///< by capture time
  std::vector<EventSample> events;  ///< by capture time
  std::map<std::string, StreamLedger> ledger;
  HostTime start;  ///< the first sample's capture time: time 0 of files
  std::size_t full_searches = 0;
  std::vector<std::string> warnings;  ///< what a user should know: shutter not known, focal length drifts, …

  double time_s(const MotionRow& row) const { return row.capture.seconds_since(start); }
};

struct TrackOptions {
  BodyTrackerOptions tracker;
  int threads = 2;
  /// Frames per piece of work. Each piece starts with a full search and depends on nothing else, so that the
  /// result does not depend on the number of threads. Memory: about (threads + 2)·chunk frames.
  int chunk_frames = 48;
  /// Frames of two cameras belong to one instant when they are at most this far apart.
  double same_instant_s = 0.002;
  /// 0..1 of the source that is read, for progress; may be empty.
  std::function<double()> fraction_read;
};

/// Pulls the source to its end. Refused with kInput: no frame of a camera of the rig, images of another size
/// than the rig says; errors of the source are passed on. `progress`: update() is called from the calling
/// thread.
Result<SessionMotion> track_session(Source& source, const Rig& rig, const TrackOptions& options,
                                    Progress& progress);

}  // namespace gnathion
