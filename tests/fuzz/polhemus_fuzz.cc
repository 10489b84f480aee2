// The Polhemus decoder against arbitrary bytes, cut into arbitrary transfers: the first byte chooses the
// record format and seeds the cuts. What comes out must account for every byte that went in.
#include <cstdint>
#include <string>

#include "acquisition/usb/polhemus_protocol.h"
#include "core/check.h"

using namespace gnathion;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const PolhemusFormat format{(data[0] & 1) != 0};
  std::size_t piece = 1 + data[0] / 2, fed = 1, told = 0;
  PolhemusDecoder decoder(format);
  std::vector<PolhemusRecord> records;
  while (fed < size) {
    const std::size_t n = std::min(piece, size - fed);
    decoder.feed({reinterpret_cast<const char*>(data) + fed, n}, records);
    fed += n;
    piece = piece * 5 % 127 + 1;
  }
  decoder.flush(records);
  PolhemusFrameTimer timer(240);
  for (const PolhemusRecord& record : records) {
    if (const auto* pose = std::get_if<PolhemusPose>(&record)) {
      GNATHION_CHECK(pose->station >= 1 && pose->station <= 16);
      (void)is_plausible(*pose);
      (void)polhemus_error(pose->error);
      (void)timer.time_ns(pose->time_ms, pose->frame);
      told += 8 + format.body_size();
    } else if (const auto* reply = std::get_if<PolhemusReply>(&record)) {
      told += 8 + reply->body.size();
    } else {
      told += std::get<PolhemusGarbage>(record).bytes;
    }
  }
  GNATHION_CHECK(told == size - 1);
  return 0;
}
