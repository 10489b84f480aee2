#include "core/random.h"

#include <cmath>

namespace gnathion {

Random::Random(std::uint64_t seed, std::uint64_t stream) : state_(0), increment_((stream << 1u) | 1u) {
  next_u32();
  state_ += seed;
  next_u32();
}

std::uint32_t Random::next_u32() {
  const std::uint64_t old = state_;
  state_ = old * 6364136223846793005ULL + increment_;
  const auto xorshifted = static_cast<std::uint32_t>(((old >> 18u) ^ old) >> 27u);
  const auto rot = static_cast<std::uint32_t>(old >> 59u);
  return (xorshifted >> rot) | (xorshifted << ((32u - rot) & 31u));
}

double Random::uniform() {
  const std::uint64_t high = next_u32() >> 5u, low = next_u32() >> 6u;
  return static_cast<double>(high * 67108864ULL + low) / 9007199254740992.0;
}

double Random::uniform(double low, double high) {
  return low + (high - low) * uniform();
}

double Random::normal() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
  const double angle = 2.0 * M_PI * uniform();
  spare_ = radius * std::sin(angle);
  has_spare_ = true;
  return radius * std::cos(angle);
}

Vector3 Random::unit_vector() {
  const double z = uniform(-1.0, 1.0), angle = uniform(0.0, 2.0 * M_PI);
  const double r = std::sqrt(1.0 - z * z);
  return {r * std::cos(angle), r * std::sin(angle), z};
}

Matrix3 Random::rotation() {
  const double a = normal(), b = normal(), c = normal(), d = normal();
  return Eigen::Quaterniond(a, b, c, d).normalized().toRotationMatrix();
}

std::uint32_t Random::below(std::uint32_t n) {
  return static_cast<std::uint32_t>((static_cast<std::uint64_t>(next_u32()) * n) >> 32u);
}

}  // namespace gnathion
