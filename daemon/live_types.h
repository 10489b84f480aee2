// What the live side of the daemon hands around: plain structs, shared and never changed once published.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "acquisition/device.h"
#include "core/rigid.h"
#include "core/sample.h"
#include "daemon/mailbox.h"

namespace gnathion::daemon {

/// One body's pose at one instant.
struct LivePose {
  std::string body, reference;  ///< "bow" in "rig"; "jaw" in "head_frame" or "dental"
  bool valid = false;
  std::string reason;
  Rigid3 reference_from_body;  ///< mm; "jaw" in "dental": the mandible's motion from MI
  std::optional<Matrix6> covariance;
  double rms_px = 0;
  int tags = 0;
  std::string mi;  ///< "jaw" in "dental": what stands for MI
};

struct LivePoses {
  std::uint64_t index = 0;
  std::uint32_t sequence = 0;
  HostTime capture;
  HostTime taken;      ///< when the daemon's camera thread had the frame
  HostTime published;  ///< when the poses were there
  std::vector<LivePose> poses;
};

struct LiveFrame {
  FrameSample frame;
  HostTime taken;
};

/// Outline of a tag in one camera's frame.
struct LiveTag {
  int id = 0;
  std::string body;
  std::array<float, 8> corners_px{};
};
struct LiveTags {
  std::uint32_t sequence = 0;
  std::vector<LiveTag> tags;
};

/// Counts of one stream since Arm, made in the device's thread.
struct LiveCounts {
  std::uint64_t received = 0, missing = 0, rejected = 0;
  std::string last_reason;
  double rate_hz = 0;
};

/// The channels that subscribers listen to. They live as long as the daemon; sessions come and go.
struct LiveChannels {
  Hub<LivePoses> poses;
  Hub<EventSample> events;
  Hub<LiveFrame> frames;
  void close() {
    poses.close();
    events.close();
    frames.close();
  }
};

}  // namespace gnathion::daemon
