#include "phantom/jaws.h"

#include <algorithm>
#include <cmath>

#include <tbb/parallel_for.h>

#include "core/random.h"
#include "phantom/jaws_arch.h"
#include "phantom/jaws_bite.h"
#include "phantom/jaws_gingiva.h"
#include "phantom/jaws_joint.h"
#include "phantom/jaws_surface.h"

namespace gnathion {
namespace {

constexpr double kStepMm = 0.275;
constexpr double kGumBlendMm = 0.22;  ///< rounding where gingiva and crowns meet

/// Highest point of the incisal edge over the crown's middle.
Vector3 incisal_edge(const PlacedTooth& t) {
  const ReliefPoint& r = t.crown.form().reference;
  const Vector3 p = t.crown.surface_from_above_mm(r.u_mm, r.v_mm);
  return t.to_jaw(p);
}

Vector3 central_fossa(const PlacedTooth& t) {
  const ReliefPoint& r = t.crown.form().points[t.crown.form().central_fossa];
  return t.to_jaw(t.crown.surface_from_above_mm(r.u_mm, r.v_mm));
}

/// All teeth moved so that the upper incisal point is the origin.
void put_origin_at_incisal_point(DentalArches& arches) {
  const Vector3 origin = 0.5 * (incisal_edge(arches.upper.tooth(11)) + incisal_edge(arches.upper.tooth(21)));
  for (DentalArch* arch : {&arches.upper, &arches.lower}) {
    for (PlacedTooth& t : arch->teeth) t.origin_mm -= origin;
  }
}

PhantomLandmarks landmarks_of(const DentalArches& arches, Random& random) {
  PhantomLandmarks l;
  l.lower_incisal_point_mm =
      0.5 * (incisal_edge(arches.lower.tooth(31)) + incisal_edge(arches.lower.tooth(41)));
  l.molar_left_mm = central_fossa(arches.lower.tooth(36));
  l.molar_right_mm = central_fossa(arches.lower.tooth(46));
  const double half = 51.0 + 1.2 * random.normal();
  const Vector3 middle(0.4 * random.normal(), 88.0 + 1.5 * random.normal(), 35.0 + 1.5 * random.normal());
  const Vector3 slant(half, 0.5 * random.normal(), 0.5 * random.normal());
  l.condyle_left_mm = middle + slant;
  l.condyle_right_mm = middle - slant;
  return l;
}

/// Distance to the crowns of a jaw; the lower ones are ground where the upper ones stand.
double crowns_mm(const DentalArches& arches, bool upper, const Vector3& p) {
  if (upper) return arches.upper.crowns_mm(p);
  const double d = arches.lower.crowns_mm(p);
  if (d > 0.6 || d < -1.5) return d;
  return smooth_max(d, -arches.upper.crowns_mm(p), 0.06);
}

TriangleMesh jaw_surface(const DentalArches& arches, const Gingiva& gingiva, bool upper) {
  const SurfaceField field = [&](const Vector3& p) {
    return smooth_min(crowns_mm(arches, upper, p), gingiva.distance_mm(p), kGumBlendMm);
  };
  const TriangleMesh whole = polygonised(field, gingiva.box_mm(), kStepMm);
  return largest_component(trimmed(whole, [&](const Vector3& p) { return gingiva.beyond_rim_mm(p); }));
}

/// The crown that each vertex belongs to; 0 where the gingiva is nearer.
std::vector<std::uint8_t> labels(const TriangleMesh& mesh, const DentalArch& arch, const Gingiva& gingiva) {
  std::vector<std::uint8_t> fdi(mesh.vertices_mm.size(), 0);
  tbb::parallel_for(std::size_t{0}, fdi.size(), [&](std::size_t i) {
    const Vector3& p = mesh.vertices_mm[i];
    double nearest = gingiva.distance_mm(p);
    for (const PlacedTooth& t : arch.teeth) {
      if ((p - t.centre_mm()).norm() > t.radius_mm() + 1.0) continue;
      const double d = t.distance_mm(p);
      if (d >= nearest) continue;
      nearest = d;
      fdi[i] = static_cast<std::uint8_t>(t.fdi);
    }
  });
  return fdi;
}

}  // namespace

PhantomJaws make_phantom_jaws(std::uint64_t seed) {
  Random random(seed, 3);
  const ArchPlan plan = random_arch_plan(random);
  DentalArches arches = lay_out_arches(plan, random);
  settle_into_occlusion(arches);
  put_origin_at_incisal_point(arches);

  PhantomJaws jaws;
  jaws.landmarks = landmarks_of(arches, random);
  const Gingiva upper_gingiva(arches.upper, seed), lower_gingiva(arches.lower, seed);
  jaws.maxilla = jaw_surface(arches, upper_gingiva, true);
  jaws.mandible_mi = jaw_surface(arches, lower_gingiva, false);
  jaws.maxilla_fdi = labels(jaws.maxilla, arches.upper, upper_gingiva);
  jaws.mandible_fdi = labels(jaws.mandible_mi, arches.lower, lower_gingiva);
  grind_in(jaws);
  make_joints(jaws, seed);
  return jaws;
}

}  // namespace gnathion
