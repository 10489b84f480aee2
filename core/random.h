// Seeded random numbers that are the same on every machine and library (std distributions are not).
#pragma once

#include <cstdint>

#include "core/rigid.h"

namespace gnathion {

/// PCG32 (O'Neill 2014) with its own distributions. Not thread-safe: one per thread.
class Random {
 public:
  explicit Random(std::uint64_t seed, std::uint64_t stream = 0);
  std::uint32_t next_u32();
  double uniform();                         ///< [0, 1)
  double uniform(double low, double high);  ///< [low, high)
  double normal();                          ///< mean 0, variance 1 (Box–Muller)
  Vector3 normal3() { return {normal(), normal(), normal()}; }
  Vector3 unit_vector();
  Matrix3 rotation();  ///< uniform on SO(3)
  /// Integer in [0, n).
  std::uint32_t below(std::uint32_t n);

 private:
  std::uint64_t state_, increment_;
  double spare_ = 0.0;
  bool has_spare_ = false;
};

}  // namespace gnathion
