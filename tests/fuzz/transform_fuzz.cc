// The transform reader against arbitrary text.
#include <cstdint>
#include <string>

#include "core/transform_io.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)gnathion::parse_motion(std::string(reinterpret_cast<const char*>(data), size), "fuzz");
  return 0;
}
