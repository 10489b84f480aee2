#include "design/solid_distance.h"

#include <cmath>

namespace gnathion {
namespace {

constexpr double kClearCosine = 0.9;   // faces have 1; beside edges and vertices rays are asked
constexpr double kOnSurfaceMm = 0.03;  // nearer than this the normal is right unless it lies across

/// Downwards and askew to the axes, edges and symmetry planes of any scan.
const Vector3 kDirections[3] = {Vector3(0.3217, 0.4871, -0.8119).normalized(),
                                Vector3(-0.7421, 0.2113, -0.6361).normalized(),
                                Vector3(0.1873, -0.8217, -0.5383).normalized()};

bool odd(const MeshQuery& solid, const Vector3& p, int direction) {
  return solid.count_crossings(p, kDirections[direction]) % 2 != 0;
}

}  // namespace

std::optional<SignedDistance> solid_distance(const MeshQuery& solid, const Vector3& p_mm,
                                             double max_distance_mm) {
  auto found = solid.signed_distance(p_mm, max_distance_mm);
  if (!found) return found;
  const double distance = std::abs(found->distance_mm);
  const Vector3 way = p_mm - found->closest.point_mm;
  const double cosine = way.dot(found->closest.normal) / (way.norm() * found->closest.normal.norm() + 1e-300);
  if (distance < 1e-4 || (distance < kOnSurfaceMm && std::abs(cosine) >= kClearCosine)) return found;
  const bool by_normal = found->distance_mm < 0.0;
  if (odd(solid, p_mm, 0) == by_normal) return found;
  const int votes = (by_normal ? 0 : 1) + (odd(solid, p_mm, 1) ? 1 : 0) + (odd(solid, p_mm, 2) ? 1 : 0);
  const bool inside = votes >= 2;
  found->distance_mm = inside ? -distance : distance;
  return found;
}

}  // namespace gnathion
