// A UVC camera's depth stream over libusb: probe, commit, payloads off the bulk endpoint.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "acquisition/scanner/depth_protocol.h"

namespace gnathion {

struct UvcDepthChoice {
  std::uint16_t vendor = 0, product = 0;
  std::string serial;  ///< empty: the only one
  int width_px = 0, height_px = 0;
};

/// libusb is used directly: libuvc 0.0.6 knows no Z16 and refuses to start a stream of a format that it does
/// not know. Isochronous endpoints are refused by name. One thread; the kernel's driver is put aside while it
/// lives.
class UvcDepthStream {
 public:
  /// Finds the camera, claims its depth interface, negotiates the mode. Errors (kInput) in one line: not
  /// there, several, no permission (names the rule), no Z16 of that size (names what there is), isochronous.
  static Result<std::unique_ptr<UvcDepthStream>> open(const UvcDepthChoice& choice, const std::string& where);
  ~UvcDepthStream();

  struct Event {
    std::optional<DepthImage> frame;
    std::string lost;  ///< why a frame was given up; empty: none was
  };
  /// Waits for the next payload at most `timeout_ms`. Error: the camera is gone or does not answer any more.
  Result<Event> next(int timeout_ms);
  const std::string& model() const { return model_; }
  const std::string& serial() const { return serial_; }

 private:
  UvcDepthStream();
  struct Usb;
  std::unique_ptr<Usb> usb_;
  std::string where_, model_, serial_;
  DepthMode mode_;
  std::unique_ptr<PayloadAssembler> assembler_;
  std::string buffer_;
};

}  // namespace gnathion
