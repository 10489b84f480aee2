// The seam between an instrument's state and its bytes: libusb, hidapi, or a recording of either.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "core/time.h"

namespace gnathion {

/// How a transfer ended, as TransferSample::status. The numbers are libusb's, for HID too.
enum TransferStatus : std::int32_t {
  kTransferOk = 0,
  kTransferIo = -1,
  kTransferAccess = -3,
  kTransferGone = -4,  ///< the device is no longer there
  kTransferBusy = -6,
  kTransferTimeout = -7,   ///< nothing came for as long as the instrument may be silent
  kTransferOverflow = -8,  ///< the endpoint sent more than a packet holds (babble)
  kTransferStall = -9,
  kTransferOther = -99,
};
/// "stall", "babble", "timeout", …
const char* name_of(TransferStatus status);

/// Endpoint 0x80: what was read of the instrument's own description when it was opened.
constexpr std::uint8_t kDescriptorEndpoint = 0x80;
constexpr std::uint8_t kDirectionIn = 0x80;

struct Transfer {
  std::uint8_t endpoint = 0;
  std::int32_t status = kTransferOk;
  std::string data;
  HostTime arrival;
};

/// Who an instrument is, as its descriptors say; empty where they say nothing.
struct InstrumentIdentity {
  std::uint16_t vendor = 0, product = 0;
  std::string manufacturer, model, serial;
  std::string port;  ///< where it is plugged in: bus-port.port, "1-2.3"
};
/// "0f44:ff20".
std::string usb_id(std::uint16_t vendor, std::uint16_t product);

/// An open instrument. One thread at a time.
class Transport {
 public:
  virtual ~Transport() = default;
  /// The next transfer that ended, errors included; nothing when none did within `timeout`.
  virtual std::optional<Transfer> read(std::chrono::milliseconds timeout) = 0;
  /// Sends, and tells how that ended.
  virtual Transfer write(std::string_view bytes) = 0;
  /// What opening it read of its descriptors, on endpoint 0x80: the first transfer of every recording.
  virtual Transfer descriptors() const = 0;
  virtual const InstrumentIdentity& identity() const = 0;
};

/// Finds the one instrument that the configuration means, again and again. One thread at a time.
class TransportFinder {
 public:
  virtual ~TransportFinder() = default;
  /// Opens it, or says in one line why not: none there, several, no permission, descriptors that lie.
  virtual Result<std::unique_ptr<Transport>> open() = 0;
  /// Waits until devices come or go, at most `timeout`.
  virtual void wait_for_change(std::chrono::milliseconds timeout) = 0;
};

/// Which of the instruments that fit is meant: any single one, or that of a serial number or port.
struct InstrumentChoice {
  std::optional<std::string> serial, port;
  std::optional<int> interface;  ///< of a HID device with several that fit
};
/// The index of the one that is meant; of several, the one that was open before (`last`). Nothing found,
/// several, two with one serial: an error that says which keys tell them apart. `what` is "foot pedal".
Result<std::size_t> choose_instrument(const std::vector<InstrumentIdentity>& found,
                                      const InstrumentChoice& choice,
                                      const std::optional<InstrumentIdentity>& last, const std::string& what,
                                      const std::string& where);
/// Names the rule that grants access.
tl::unexpected<Error> no_permission(const std::string& what, const std::string& where,
                                    const std::string& node);

}  // namespace gnathion
