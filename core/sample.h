// What instruments deliver, one sample at a time.
#pragma once

#include <cstdint>
#include <string>
#include <variant>

#include "core/image.h"
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

using Sample = std::variant<FrameSample, EventSample, LedgerSample>;

inline const SampleHeader& header_of(const Sample& s) {
  return std::visit([](const auto& x) -> const SampleHeader& { return x.header; }, s);
}

}  // namespace gnathion
