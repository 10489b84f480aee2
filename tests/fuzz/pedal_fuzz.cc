// Report descriptors and input reports of pedals against arbitrary bytes: two bytes give the length of the
// descriptor, what follows it are reports, each with a byte for its length and one for the time that passes.
#include <cstdint>
#include <string>

#include "acquisition/usb/pedal_protocol.h"
#include "core/check.h"

using namespace gnathion;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  const std::size_t length = std::min<std::size_t>(data[0] | (std::size_t{data[1]} << 8), size - 2);
  auto layout = HidLayout::parse(std::string_view(bytes).substr(2, length), "fuzz");
  if (!layout) return 0;
  PedalDecoder decoder(std::move(*layout));
  Debouncer debouncer(30'000'000);
  HostTime now{0};
  for (std::size_t at = 2 + length; at + 2 <= size;) {
    const std::size_t n = std::min<std::size_t>(data[at], size - at - 2);
    now.ns += std::int64_t{data[at + 1]} * 1'000'000;
    const auto edges = decoder.take(std::string_view(bytes).substr(at + 2, n));
    at += 2 + n;
    while (debouncer.passed(now)) {
    }
    if (!edges) continue;
    for (const PedalDecoder::Edge& edge : *edges) {
      GNATHION_CHECK(decoder.held().count(edge.usage) == (edge.pressed ? 1u : 0u));
      (void)name_of_usage(edge.usage);
      (void)debouncer.edge(edge.pressed, now);
    }
  }
  return 0;
}
