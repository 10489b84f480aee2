#include "design/solid_distance.h"

#include <cmath>

namespace gnathion {
namespace {

constexpr double kDoubtfulCosine = 0.5;  // a crest of 60° still has this; a fold has less

bool inside_by_vote(const MeshQuery& solid, const Vector3& p) {
  // Directions off the axes, edges and symmetry planes of any scan.
  static const Vector3 directions[3] = {Vector3(0.3217, 0.4871, -0.8119).normalized(),
                                        Vector3(-0.7421, 0.2113, -0.6361).normalized(),
                                        Vector3(0.1873, -0.8217, -0.5383).normalized()};
  int votes = 0;
  for (const Vector3& d : directions) votes += solid.count_crossings(p, d) % 2;
  return votes >= 2;
}

}  // namespace

std::optional<SignedDistance> solid_distance(const MeshQuery& solid, const Vector3& p_mm,
                                             double max_distance_mm) {
  auto found = solid.signed_distance(p_mm, max_distance_mm);
  if (!found || std::abs(found->distance_mm) < 1e-4) return found;
  const Vector3 way = p_mm - found->closest.point_mm;
  const double cosine = way.dot(found->closest.normal) / (way.norm() * found->closest.normal.norm() + 1e-300);
  if (std::abs(cosine) >= kDoubtfulCosine) return found;
  const double distance = std::abs(found->distance_mm);
  found->distance_mm = inside_by_vote(solid, p_mm) ? -distance : distance;
  return found;
}

}  // namespace gnathion
