// The reader of PLUS sequences against arbitrary bytes: any answer but a crash, a hang or a lie.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "acquisition/exchange/plus_sequence.h"

namespace {

using namespace gnathion;

void require(bool condition, const char* promise) {
  if (condition) return;
  std::fprintf(stderr, "broken promise: %s\n", promise);
  std::abort();
}

void check_accepted(const PlusSequence& s) {
  require(s.width_px >= 0 && s.height_px >= 0 && (s.width_px == 0) == (s.height_px == 0), "a size or none");
  require(s.channels >= 1 && s.channels <= 16, "a number of channels");
  for (const PlusFrame& f : s.frames) {
    require(!f.has_image || s.width_px > 0, "images have a size");
    for (const auto& [name, t] : f.transforms) require(t.valid == (t.status == "OK"), "valid says OK");
    if (!f.timestamp_ns) continue;
    require(ns_from_decimal(decimal_seconds(*f.timestamp_ns)) == f.timestamp_ns, "times keep every ns");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  if (const auto header = parse_plus_header(bytes, "fuzz")) check_accepted(header->sequence);
  auto reader = PlusReader::parse(bytes, "fuzz");
  if (!reader) return 0;
  std::size_t pixel_bytes = 0, images = 0;
  for (std::size_t total = 0; total < (1u << 20); total += pixel_bytes) {
    const auto pixels = reader->next_pixels();
    if (!pixels) break;
    require(!pixels->empty() && (pixel_bytes == 0 || pixels->size() == pixel_bytes), "images have one size");
    pixel_bytes = pixels->size();
    ++images;
  }
  require(images <= reader->sequence().frames.size(), "an image a frame");
  return 0;
}
