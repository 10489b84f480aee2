// Unpacking of gzip and raw deflate streams, piece by piece.
#pragma once

#include <functional>
#include <string>
#include <string_view>

namespace gnathion {

enum class Packing { kGzip, kRawDeflate };

/// Hands unpacked pieces to `take` until the stream ends, `take` returns false (enough), or `most_bytes` have
/// come. Returns the reason why not, or nothing: "truncated", "damaged", "unpacks to more than … bytes".
std::string unpack(std::string_view packed, Packing packing, std::uint64_t most_bytes,
                   const std::function<bool(std::string_view)>& take);

}  // namespace gnathion
