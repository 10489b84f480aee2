#include "anatomy/volume/inflate.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <vector>

namespace gnathion {
namespace {

struct Stream {
  z_stream z{};
  bool ok;
  explicit Stream(Packing packing)
      : ok(inflateInit2(&z, packing == Packing::kGzip ? 15 + 16 : -15) == Z_OK) {}
  ~Stream() {
    if (ok) inflateEnd(&z);
  }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;
};

}  // namespace

std::string unpack(std::string_view packed, Packing packing, std::uint64_t most_bytes,
                   const std::function<bool(std::string_view)>& take) {
  Stream stream(packing);
  if (!stream.ok) return "zlib does not start";
  std::vector<char> piece(1 << 20);
  std::uint64_t total = 0;
  std::size_t fed = 0;
  bool ended = false;  // of one member; gzip files may hold several
  for (;;) {
    if (stream.z.avail_in == 0) {
      const std::size_t count = std::min<std::size_t>(packed.size() - fed, 1 << 30);
      if (count == 0) return ended ? "" : "truncated";
      stream.z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data() + fed));
      stream.z.avail_in = static_cast<uInt>(count);
      fed += count;
    }
    if (ended) {  // what follows a member is another one, or padding
      if (packing == Packing::kRawDeflate || *stream.z.next_in != 0x1f) return "";
      if (inflateReset(&stream.z) != Z_OK) return "damaged";
      ended = false;
    }
    stream.z.next_out = reinterpret_cast<Bytef*>(piece.data());
    stream.z.avail_out = static_cast<uInt>(piece.size());
    const int code = inflate(&stream.z, Z_NO_FLUSH);
    if (code != Z_OK && code != Z_STREAM_END && code != Z_BUF_ERROR) return "damaged";
    const std::size_t made = piece.size() - stream.z.avail_out;
    total += made;
    if (total > most_bytes) return fmt::format("unpacks to more than {} bytes", most_bytes);
    if (made > 0 && !take({piece.data(), made})) return "";
    if (code == Z_BUF_ERROR && made == 0 && stream.z.avail_in > 0) return "damaged";
    ended = code == Z_STREAM_END;
  }
}

}  // namespace gnathion
