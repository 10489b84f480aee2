#include "phantom/patient_therapy.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>
#include <numbers>

#include "core/check.h"
#include "core/mesh_query.h"
#include "core/random.h"

namespace gnathion {
namespace {

constexpr double kRad = std::numbers::pi / 180.0;
constexpr double kFar_mm = 8.0;

struct Clearance {
  double all_mm = kFar_mm, posterior_mm = kFar_mm;
};

/// Of the crowns' vertices of one jaw, moved into the other's frame.
Clearance clearance_of(const TriangleMesh& mesh, const std::vector<std::uint8_t>& fdi, const Rigid3& motion,
                       const MeshQuery& other) {
  std::vector<double> distance(fdi.size(), kFar_mm);
  tbb::parallel_for(std::size_t{0}, fdi.size(), [&](std::size_t v) {
    if (fdi[v] == 0) return;
    const auto found = other.signed_distance(motion * mesh.vertices_mm[v], kFar_mm);
    if (found) distance[v] = found->distance_mm;
  });
  Clearance out;
  for (std::size_t v = 0; v < fdi.size(); ++v) {
    out.all_mm = std::min(out.all_mm, distance[v]);
    if (fdi[v] % 10 >= 4) out.posterior_mm = std::min(out.posterior_mm, distance[v]);
  }
  return out;
}

void measure(const PhantomJaws& jaws, const MeshQuery& maxilla, const MeshQuery& mandible,
             TherapeuticPosition& p) {
  const Clearance lower = clearance_of(jaws.mandible_mi, jaws.mandible_fdi, p.motion.rigid, maxilla);
  const Clearance upper = clearance_of(jaws.maxilla, jaws.maxilla_fdi, p.motion.rigid.inverse(), mandible);
  p.clearance_mm = std::min(lower.all_mm, upper.all_mm);
  p.posterior_clearance_mm = std::min(lower.posterior_mm, upper.posterior_mm);
}

/// Slide of the condyles forward and down their slope and to the side, then hinge opening about their axis.
Motion<Dental> slide_and_open(const PhantomLandmarks& at, const TherapeuticPosition& p, double slope_rad) {
  const Vector3 slide(p.lateral_mm, -p.protrusion_mm * std::cos(slope_rad),
                      -p.protrusion_mm * std::sin(slope_rad));
  const Vector3 axis = at.condyle_left_mm - at.condyle_right_mm;
  // x points to the patient's left: a positive turn about it takes the front (-y) down.
  const Rigid3 hinge = Rigid3::about_axis(at.condyle_right_mm, axis, p.opening_deg * kRad);
  return Motion<Dental>(Rigid3::from_translation(slide) * hinge);
}

}  // namespace

void measure_clearance(const PhantomJaws& jaws, TherapeuticPosition& position) {
  measure(jaws, MeshQuery(jaws.maxilla), MeshQuery(jaws.mandible_mi), position);
}

TherapeuticPosition draw_therapeutic_position(const PhantomJaws& jaws, std::uint64_t seed) {
  Random random(seed, 0x7EA9);
  TherapeuticPosition p;
  p.opening_deg = random.uniform(2.4, 3.6);
  p.protrusion_mm = random.uniform(0.5, 2.0);
  p.lateral_mm = random.uniform(-0.6, 0.6);
  const double slope_rad = random.uniform(32, 42) * kRad;
  const MeshQuery maxilla(jaws.maxilla), mandible(jaws.mandible_mi);
  for (;;) {
    p.motion = slide_and_open(jaws.landmarks, p, slope_rad);
    measure(jaws, maxilla, mandible, p);
    if (p.posterior_clearance_mm >= 1.1 && p.clearance_mm >= 0.3) return p;
    p.opening_deg += 0.25;
    if (p.opening_deg <= 5.0) continue;
    // Cusps meet in spite of the opening: less slide and shift bring them back over their fossae.
    p.opening_deg = 3.6;
    p.protrusion_mm = std::max(0.5, 0.7 * p.protrusion_mm);
    p.lateral_mm *= 0.5;
    GNATHION_CHECK(std::abs(p.lateral_mm) > 1e-3);  // such jaws would be no jaws
  }
}

}  // namespace gnathion
