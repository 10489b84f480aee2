// Bulk endpoints over libusb.
#pragma once

#include <memory>
#include <vector>

#include "acquisition/usb/transport.h"

namespace gnathion {

struct UsbProduct {
  std::uint16_t vendor = 0, product = 0;
  const char* model = "";
  bool needs_firmware = false;  ///< it shows this id only until its loader has run
};

/// Finds devices of `products` with a bulk endpoint of each direction on their first interface. Endpoints
/// come from the descriptors; ones that cannot be (none, wrong type, packets of 0 bytes) are refused by name.
/// `clock` outlives the finder and its transports. The finder outlives its transports.
Result<std::unique_ptr<TransportFinder>> find_usb(std::vector<UsbProduct> products, InstrumentChoice choice,
                                                  std::string what, std::string where, Clock& clock);

}  // namespace gnathion
