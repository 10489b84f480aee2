#include "core/triangle_bundle.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace gnathion {
namespace {

/// Sixteen times what a sum of some products loses in single precision, of the lengths that go in.
constexpr double kRounding = 4e-6;
constexpr double kThinnest = 1e-3;  // height over longest side: beneath, single precision tells nothing

double reciprocal(double x) {
  return x > 1e-30 ? 1.0 / x : 0.0;
}

}  // namespace

void TriangleBundle::set(int lane, const Vector3& a, const Vector3& b, const Vector3& c, double reach_mm) {
  const Vector3 ab = b - a, ac = c - a;
  const auto put = [lane](Vector3Lanes& lanes, const Vector3& v) {
    lanes.x[lane] = static_cast<float>(v.x());
    lanes.y[lane] = static_cast<float>(v.y());
    lanes.z[lane] = static_cast<float>(v.z());
  };
  put(a_, a);
  put(ab_, ab);
  put(ac_, ac);
  const double ab2 = ab.squaredNorm(), ac2 = ac.squaredNorm(), bc2 = (c - b).squaredNorm();
  const double area2 = ab.cross(ac).squaredNorm();
  ab2_[lane] = static_cast<float>(ab2);
  ac2_[lane] = static_cast<float>(ac2);
  abac_[lane] = static_cast<float>(ab.dot(ac));
  by_ab2_[lane] = static_cast<float>(reciprocal(ab2));
  by_ac2_[lane] = static_cast<float>(reciprocal(ac2));
  by_bc2_[lane] = static_cast<float>(reciprocal(bc2));
  by_area2_[lane] = static_cast<float>(reciprocal(area2));
  // The foot's coordinates lose with the square of how thin the triangle is.
  const double longest2 = std::max({ab2, ac2, bc2}), thin = std::sqrt(area2) / std::max(longest2, 1e-300);
  const double size = reach_mm + a.norm() + std::sqrt(longest2);
  room_mm_[lane] = thin > kThinnest ? static_cast<float>(kRounding * size / (thin * thin))
                                    : std::numeric_limits<float>::infinity();
}

/// Squared distance to a side, whose nearest point is `part` of the way along it.
inline TriangleBundle::Lanes TriangleBundle::side_squared(const Vector3Lanes& to_p, const Vector3Lanes& side,
                                                          const Lanes& part) {
  const Lanes zero{}, one = zero + 1.0f;
  const Lanes t = part < zero ? zero : part > one ? one : part;
  const Vector3Lanes off{to_p.x - t * side.x, to_p.y - t * side.y, to_p.z - t * side.z};
  return dot(off, off);
}

unsigned TriangleBundle::near(const Eigen::Vector3f& p, float within_mm) const {
  const Vector3Lanes ap{p.x() - a_.x, p.y() - a_.y, p.z() - a_.z};
  const Lanes along_ab = dot(ab_, ap), along_ac = dot(ac_, ap);
  const Lanes v = (ac2_ * along_ab - abac_ * along_ac) * by_area2_;
  const Lanes w = (ab2_ * along_ac - abac_ * along_ab) * by_area2_;
  const Vector3Lanes off{ap.x - v * ab_.x - w * ac_.x, ap.y - v * ab_.y - w * ac_.y,
                         ap.z - v * ab_.z - w * ac_.z};
  const Lanes to_plane = dot(off, off);

  const Vector3Lanes bp{ap.x - ab_.x, ap.y - ab_.y, ap.z - ab_.z};
  const Vector3Lanes bc{ac_.x - ab_.x, ac_.y - ab_.y, ac_.z - ab_.z};
  const Lanes to_ab = side_squared(ap, ab_, along_ab * by_ab2_);
  const Lanes to_ac = side_squared(ap, ac_, along_ac * by_ac2_);
  const Lanes to_bc = side_squared(bp, bc, dot(bc, bp) * by_bc2_);
  Lanes squared = to_ab < to_ac ? to_ab : to_ac;
  squared = squared < to_bc ? squared : to_bc;
  const Lanes zero{};
  const auto inside = (v > zero) & (w > zero) & (v + w < zero + 1.0f);
  squared = inside ? to_plane : squared;

  const Lanes limit = within_mm + room_mm_;
  // Whatever is no number counts as near.
  const auto far = (squared > limit * limit) | (limit < zero);
  std::uint64_t halves[2];
  static_assert(sizeof(far) == sizeof(halves));
  std::memcpy(halves, &far, sizeof(halves));
  if ((halves[0] & halves[1]) == ~std::uint64_t{0}) return 0;
  unsigned bits = 0;
  for (int lane = 0; lane < kLanes; ++lane) bits |= far[lane] ? 0u : 1u << lane;
  return bits;
}

}  // namespace gnathion
