#include "acquisition/camera/frame_counter.h"

namespace gnathion {
namespace {

/// GigE Vision 1.x block ids: 1 to 65535, then 1 again (GigE Vision 2.0.03, 24.2).
constexpr std::uint64_t kWrap = 65535;

}  // namespace

FrameCounter::Place FrameCounter::take(std::uint64_t device_counter) {
  if (!last_device_) {
    last_device_ = device_counter;
    return {next_++, 0, false};
  }
  const std::uint64_t last = *last_device_;
  std::uint64_t unwrapped = device_counter;
  if (last <= kWrap && device_counter <= kWrap) {
    if (device_counter + kWrap / 2 < last) unwrapped += kWrap;
    if (device_counter > last + kWrap / 2) return {next_, 0, true};  // from before the wrap
  }
  if (unwrapped <= last) return {next_, 0, true};
  const auto missing = static_cast<std::uint32_t>(unwrapped - last - 1);
  last_device_ = device_counter;
  next_ += missing;
  return {next_++, missing, false};
}

FrameCounter::Place FrameCounter::take_unnumbered() {
  if (last_device_) last_device_ = *last_device_ == kWrap ? 1 : *last_device_ + 1;
  return {next_++, 0, false};
}

FrameCounter::Place FrameCounter::take_next(std::uint32_t skipped) {
  next_ += skipped;
  return {next_++, skipped, false};
}

}  // namespace gnathion
