// Input reports over hidapi (hidraw).
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "acquisition/usb/transport.h"

namespace gnathion {

struct HidProduct {
  std::uint16_t vendor = 0, product = 0;
  const char* model = "";
};

/// Finds the interface of one of `products` whose report descriptor `fits` accepts (an error says why not).
/// Its descriptors() are that report descriptor; input reports come on endpoint 0. `clock` outlives the
/// finder and its transports.
std::unique_ptr<TransportFinder> find_hid(std::vector<HidProduct> products, InstrumentChoice choice,
                                          std::function<Status(const std::string& report_descriptor)> fits,
                                          std::string what, std::string where, Clock& clock);

}  // namespace gnathion
