// A camera's own frame counter, unwrapped, so that each number is accounted for once.
#pragma once

#include <cstdint>
#include <optional>

namespace gnathion {

/// Numbers frames of one stream for ever on: a counter that wraps (GigE Vision block ids go from 65535 to 1)
/// or starts again after a reconnect continues where it was.
class FrameCounter {
 public:
  struct Place {
    std::uint32_t sequence = 0;  ///< the stream's
    std::uint32_t missing = 0;   ///< numbers skipped just before it
    bool repeated = false;       ///< a number that was there before, or one from before the last
  };
  /// `device_counter` as the camera gave it.
  Place take(std::uint64_t device_counter);
  /// A frame whose number did not arrive: taken as the one after the last.
  Place take_unnumbered();
  /// For cameras without a counter: `skipped` frames are known to be missing before this one.
  Place take_next(std::uint32_t skipped);
  /// The camera counts anew from here.
  void restart() { last_device_.reset(); }

 private:
  std::optional<std::uint64_t> last_device_;
  std::uint32_t next_ = 0;
};

}  // namespace gnathion
