// A Polhemus tracker behind the real libusb: it powers up as the manual says (ASCII, inches, Euler angles)
// and does what it is told, so that a driver that forgets a command gets wrong numbers.
#pragma once

#include <atomic>
#include <cmath>
#include <string>
#include <vector>

#include "acquisition/usb/polhemus_protocol.h"
#include "tests/support/mock_usb.h"

namespace gnathion::mock {

class Tracker {
 public:
  Tracker(Bed& bed, UsbSpec spec, std::vector<int> stations = {1, 2})
      : usb(bed, std::move(spec)), stations_(std::move(stations)) {
    usb.on_write = [this](const std::string& bytes) { obey(bytes); };
    usb.on_idle = [this] { return idle(); };
  }

  /// Where sensor `station` truly is in frame `n`: its position in mm and its rotation about the z axis.
  static double x_mm(int station, std::uint32_t n) { return 100.0 * station + 0.25 * (n % 1000); }
  static double angle_rad(int station, std::uint32_t n) { return 0.1 * station + 0.001 * (n % 1000); }

  /// The bytes of frame `n`, in the unit that is set.
  std::string frame(std::uint32_t n) const {
    std::string bytes;
    for (const int station : stations_) bytes += encode(pose(station, n), {distortion_}, tag);
    return bytes;
  }
  PolhemusPose pose(int station, std::uint32_t n) const {
    const double unit_mm = centimetres_ ? 10.0 : 25.4;
    PolhemusPose p;
    p.station = station;
    p.frame = n;
    p.time_ms = static_cast<std::uint32_t>(std::floor(n * 1000.0 / rate_hz + 7.25));
    p.position_cm[0] = static_cast<float>(x_mm(station, n) / unit_mm);
    p.position_cm[1] = static_cast<float>(-50.0 / unit_mm);
    p.position_cm[2] = static_cast<float>(20.0 / unit_mm);
    p.quaternion[0] = static_cast<float>(std::cos(angle_rad(station, n) / 2));
    p.quaternion[3] = static_cast<float>(std::sin(angle_rad(station, n) / 2));
    return p;
  }

  Usb usb;
  std::string tag = "LY";
  double rate_hz = 240;
  std::atomic<std::uint32_t> next_frame = 1000;
  std::atomic<bool> runs = true;         ///< frames come by themselves once it was started
  std::atomic<std::uint32_t> limit = 0;  ///< 0, or the last frame that comes by itself
  std::atomic<int> starts = 0;
  std::atomic<bool> answers = true;
  std::atomic<char> refuses = 0;  ///< a command that it does not take
  bool sensors_connected = true;
  std::atomic<bool> deaf = false;  ///< goes on sending whatever it is told

  void power_cycle() { binary_ = centimetres_ = quaternion_ = distortion_ = streaming_ = false; }
  bool streaming() const { return streaming_; }
  void fall_silent() { streaming_ = false; }

 private:
  void obey(const std::string& bytes) {
    pending_ += bytes;
    while (!pending_.empty()) {
      if (pending_[0] == 'P') {  // no carriage return after this one
        pending_.erase(0, 1);
        if (!deaf) streaming_ = false;
        if (answers)
          usb.push(binary_ ? frame(next_frame) : "01  12.34  -5.67   8.90  10.00  20.00  30.00\r\n");
        continue;
      }
      const std::size_t end = pending_.find('\r');
      if (end == std::string::npos) return;
      command(pending_.substr(0, end));
      pending_.erase(0, end + 1);
    }
  }
  void command(const std::string& c) {
    if (deaf) return;
    if (refuses != 0 && c[0] == refuses) {
      usb.push(encode(PolhemusReply{0, static_cast<std::uint8_t>(c[0]), 0x07, "above limit\r\n"}, tag));
      return;
    }
    if (c == "F1") binary_ = true;
    if (c == "U1") centimetres_ = true;
    if (c == "O*,8,9,2,7") quaternion_ = true;
    if (c == "O*,8,9,11,2,7") quaternion_ = distortion_ = true;
    if (c == "\x15"
             "0" &&
        answers) {
      const char active = sensors_connected ? map() : '\0';
      const std::string body{map(), 0, active, 0};
      usb.push(binary_ ? encode(PolhemusReply{0, 0x15, 0, body}, tag) : "00u0003 0003\r\n");
    }
    if (c == "C") {
      streaming_ = binary_ && quaternion_;
      ++starts;
    }
  }
  char map() const {
    int bits = 0;
    for (const int s : stations_) bits |= 1 << (s - 1);
    return static_cast<char>(bits);
  }
  std::string idle() {
    if (!streaming_ || !runs || (limit != 0 && next_frame > limit)) return {};
    return frame(next_frame++);
  }

  std::vector<int> stations_;
  std::string pending_;
  bool binary_ = false, centimetres_ = false, quaternion_ = false, distortion_ = false;
  std::atomic<bool> streaming_ = false;
};

}  // namespace gnathion::mock
