// What instruments deliver, one sample at a time.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <variant>

#include "core/image.h"
#include "core/rigid.h"
#include "core/time.h"

namespace gnathion {

/// Times and counter that every sample carries.
struct SampleHeader {
  std::string stream;          ///< "camera_0", "pedal"
  std::uint32_t sequence = 0;  ///< the device's own counter
  HostTime capture;            ///< mid-exposure, on the host's clock
  HostTime arrival;            ///< when the host had it
  DeviceTime device;           ///< device ticks, in ns
};

struct FrameSample {
  SampleHeader header;
  Image8 image;
};

/// A mark or a state of the session: "MI", "TP", "note".
struct EventSample {
  SampleHeader header;
  std::string kind;
  bool pressed = true;  ///< press (true) and release (false) of a pedal
  std::string text;
};

/// What became of a frame that was not delivered, so that none is lost without a line.
struct LedgerSample {
  SampleHeader header;
  enum class Fate : std::uint8_t { kAccepted, kRejected, kMissing } fate = Fate::kAccepted;
  std::uint32_t count = 1;  ///< how many consecutive counters, from header.sequence on
  std::string reason;       ///< "counter gap", "queue full", "short read"
};

/// A pose that an instrument reports by itself: a sensor of an electromagnetic tracker, a tool behind
/// OpenIGTLink.
struct PoseSample {
  SampleHeader header;
  std::string reference;  ///< what the pose is given in: "transmitter", "tracker"
  std::string body;       ///< what it is the pose of: "sensor_1"
  bool valid = true;
  std::string reason;          ///< why not valid
  Rigid3 reference_from_body;  ///< mm
};

/// A surface that a face scanner delivered, as the file it came in. The recording keeps the bytes as an
/// attachment.
struct ScanSample {
  SampleHeader header;
  std::string name;  ///< file name without folder, unique in the stream
  std::map<std::string, std::string>
      files;                ///< file name → bytes: the mesh first of all, its material and texture
  std::string sha256;       ///< of the mesh file's bytes
  double deviation_mm = 0;  ///< measured standard deviation along the normal; 0: not measured
};

/// One raw transfer of a USB or HID device, errors included, so that a field failure replays through the same
/// decoder.
struct TransferSample {
  SampleHeader header;
  std::uint8_t endpoint = 0;  ///< with the direction bit 0x80 for IN; 0 for HID input reports
  std::int32_t status = 0;    ///< 0, or the transport's own error code
  std::string data;           ///< what arrived, or what was sent
};

using Sample = std::variant<FrameSample, EventSample, LedgerSample, PoseSample, ScanSample, TransferSample>;

inline const SampleHeader& header_of(const Sample& s) {
  return std::visit([](const auto& x) -> const SampleHeader& { return x.header; }, s);
}

}  // namespace gnathion
