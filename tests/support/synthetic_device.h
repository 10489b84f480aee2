// A device that makes samples at a fixed rate on the real clock, for tests and measurements of recordings.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <string>

#include "acquisition/device.h"
#include "acquisition/replay.h"
#include "core/check.h"
#include "core/random.h"

namespace gnathion {

/// What a device has handed out, written before it does: the truth that outlives a killed process.
struct DeliveredSample {
  char stream[20] = {};
  std::uint32_t sequence = 0;
  std::int64_t arrival_ns = 0;
};

class SyntheticDevice : public Device {
 public:
  struct Options {
    std::string stream;
    double rate_hz = 60;        ///< 0: without waiting
    std::uint32_t samples = 0;  ///< then it ends; 0: endless
    int log_fd = -1;            ///< where DeliveredSample go
  };
  using Maker = std::function<Sample(SampleHeader header)>;

  SyntheticDevice(Options options, Maker maker, Clock& clock)
      : options_(std::move(options)), maker_(std::move(maker)), clock_(clock), waiter_(clock) {}

  Result<std::optional<Sample>> next() override {
    if (options_.samples > 0 && sequence_ == options_.samples) return std::optional<Sample>();
    if (sequence_ == 0) started_ = clock_.now();
    HostTime due = started_;
    if (options_.rate_hz > 0) due.ns += static_cast<std::int64_t>(1e9 * sequence_ / options_.rate_hz);
    if (!waiter_.wait_until(options_.rate_hz > 0 ? due : HostTime{0})) return std::optional<Sample>();
    const HostTime now = clock_.now();
    longest_delay_s_ = std::max(longest_delay_s_, options_.rate_hz > 0 ? now.seconds_since(due) : 0.0);
    Sample sample = maker_({options_.stream, sequence_, {now.ns - 4'000'000}, now, {now.ns - started_.ns}});
    if (options_.log_fd >= 0) log({options_.stream, sequence_, now});
    ++sequence_;
    return std::optional<Sample>(std::move(sample));
  }
  DeviceDescription description() const override {
    DeviceDescription d;
    d.kind = "synthetic";
    d.stream = options_.stream;
    return d;
  }
  DeviceHealth health() const override { return {}; }
  void stop() override { waiter_.cancel(); }

  /// Both once the device has ended.
  std::uint32_t delivered() const { return sequence_; }
  double longest_delay_s() const { return longest_delay_s_; }

 private:
  struct Line {
    const std::string& stream;
    std::uint32_t sequence;
    HostTime arrival;
  };
  void log(const Line& line) const {
    DeliveredSample entry;
    std::strncpy(entry.stream, line.stream.c_str(), sizeof entry.stream - 1);
    entry.sequence = line.sequence;
    entry.arrival_ns = line.arrival.ns;
    GNATHION_CHECK(::write(options_.log_fd, &entry, sizeof entry) == sizeof entry);
  }

  const Options options_;
  const Maker maker_;
  Clock& clock_;
  ClockWaiter waiter_;
  HostTime started_;
  std::uint32_t sequence_ = 0;
  double longest_delay_s_ = 0;
};

/// A picture such as a camera gives: soft shading, a checkered body, noise of 2 grey levels.
inline Image8 camera_like_image(int width_px, int height_px, std::uint64_t seed) {
  Image8 image(width_px, height_px);
  Random random(seed);
  for (int y = 0; y < height_px; ++y)
    for (int x = 0; x < width_px; ++x) {
      const bool body =
          std::abs(x - width_px / 2) < width_px / 5 && std::abs(y - height_px / 2) < height_px / 5;
      const double ground = 70 + 40.0 * x / width_px + 25.0 * y / height_px;
      const double tag = ((x / 24) + (y / 24)) % 2 ? 210 : 35;
      image.at(x, y) = static_cast<std::uint8_t>(
          std::clamp((body ? tag : ground) + 2 * random.normal() + 0.5, 0.0, 255.0));
    }
  return image;
}

inline SyntheticDevice::Maker camera_maker(std::vector<Image8> images) {
  return [images = std::move(images)](SampleHeader h) -> Sample {
    const Image8& image = images[h.sequence % images.size()];
    return FrameSample{std::move(h), image};
  };
}
inline SyntheticDevice::Maker tracker_maker() {
  return [](SampleHeader h) -> Sample {
    Random random(h.sequence);
    return PoseSample{
        std::move(h), "transmitter", "sensor_1", true, "", Rigid3{random.rotation(), 100 * random.normal3()}};
  };
}
inline SyntheticDevice::Maker pedal_maker() {
  return [](SampleHeader h) -> Sample {
    const bool pressed = h.sequence % 2 == 0;
    return EventSample{std::move(h), "MI", pressed, ""};
  };
}
inline SyntheticDevice::Maker transfer_maker() {
  return [](SampleHeader h) -> Sample {
    return TransferSample{std::move(h), 0x81, 0, std::string(64, '\x5A')};
  };
}

}  // namespace gnathion
