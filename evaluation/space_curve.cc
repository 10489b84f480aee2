#include "evaluation/space_curve.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>

#include "core/mesh.h"

namespace gnathion {
namespace {

constexpr int kBits = 10;
constexpr std::uint32_t kCells = 1u << kBits;

/// Hilbert index of a cell (Skilling 2004, "Programming the Hilbert curve"): axes to transposed index, then
/// its bits are interleaved.
std::uint32_t hilbert_code(std::array<std::uint32_t, 3> x) {
  for (std::uint32_t q = kCells >> 1; q > 1; q >>= 1) {
    const std::uint32_t low = q - 1;
    for (int i = 0; i < 3; ++i) {
      if (x[i] & q) {
        x[0] ^= low;
      } else {
        const std::uint32_t t = (x[0] ^ x[i]) & low;
        x[0] ^= t;
        x[i] ^= t;
      }
    }
  }
  x[1] ^= x[0];
  x[2] ^= x[1];
  std::uint32_t t = 0;
  for (std::uint32_t q = kCells >> 1; q > 1; q >>= 1)
    if (x[2] & q) t ^= q - 1;
  std::uint32_t code = 0;
  for (int bit = kBits - 1; bit >= 0; --bit)
    for (int i = 0; i < 3; ++i) code = (code << 1) | (((x[i] ^ t) >> bit) & 1u);
  return code;
}

}  // namespace

std::vector<std::uint32_t> hilbert_order(const std::vector<Vector3>& points_mm) {
  Box box;
  for (const Vector3& p : points_mm)
    if (p.allFinite()) box.extend(p);
  const double cell = std::max(1e-9, box.size_mm().maxCoeff()) / (kCells - 1);
  // Code above index: one sort of plain numbers.
  std::vector<std::uint64_t> keys(points_mm.size()), sorted(points_mm.size());
  tbb::parallel_for(std::size_t{0}, points_mm.size(), [&](std::size_t i) {
    std::uint64_t code = (1u << (3 * kBits)) - 1;
    if (points_mm[i].allFinite()) {
      const Vector3 at = (points_mm[i] - box.min_mm) / cell;
      code = hilbert_code({static_cast<std::uint32_t>(at.x()), static_cast<std::uint32_t>(at.y()),
                           static_cast<std::uint32_t>(at.z())});
    }
    keys[i] = code << 32 | static_cast<std::uint32_t>(i);
  });
  // Radix sort by the code: three passes of ten bits, each stable.
  for (int pass = 0; pass < 3; ++pass) {
    std::vector<std::size_t> begin(kCells + 1, 0);
    const int shift = 32 + kBits * pass;
    for (std::uint64_t k : keys) ++begin[((k >> shift) & (kCells - 1)) + 1];
    for (std::size_t i = 0; i < kCells; ++i) begin[i + 1] += begin[i];
    for (std::uint64_t k : keys) sorted[begin[(k >> shift) & (kCells - 1)]++] = k;
    keys.swap(sorted);
  }
  std::vector<std::uint32_t> order(keys.size());
  for (std::size_t i = 0; i < keys.size(); ++i) order[i] = static_cast<std::uint32_t>(keys[i]);
  return order;
}

}  // namespace gnathion
