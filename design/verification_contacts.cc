#include <algorithm>
#include <cmath>

#include "design/verification_steps.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kContactMm = 0.05;

/// Part of the natural contact area that touches the splint in TP.
double kept_fraction(const Contacts& natural, const Rigid3& design_tp_from_dental, const MeshQuery& splint) {
  std::vector<Vector3> points;
  for (const SurfaceSample& s : natural.samples) points.push_back(design_tp_from_dental * s.p_mm);
  const std::vector<ClosestHit> hits = closest_points(splint, points, kContactMm);
  double sum = 0.0, total = 0.0;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    total += natural.samples[i].area_mm2;
    if (hits[i].triangle != ClosestHit::kNoTriangle) sum += natural.samples[i].area_mm2;
  }
  return total > 0.0 ? sum / total : 0.0;
}

/// How far a point of the splint near the mandible is from the surface of (T_th M) less L_TP.
double contact_error(double stamp_mm, double mandible_mm) {
  const double outside = std::max(stamp_mm, -mandible_mm);
  return outside > 0.0 ? outside : std::min(-stamp_mm, mandible_mm);
}

void measure_contact_surface(const FinishedSplint& splint, const Preparation& preparation,
                             SplintVerification& out) {
  const Rigid3 natural_from_tp = preparation.therapeutic.inverse();
  std::vector<Vector3> biting, natural;
  for (std::size_t v = 0; v < splint.parts.size(); ++v)
    if (splint.parts[v] == SurfacePart::kImprint || splint.parts[v] == SurfacePart::kStamp)
      biting.push_back(splint.mesh().vertices_mm[v]);
  const std::vector<ClosestHit> mandible = closest_points(preparation.mandible, biting, kContactMm);
  std::vector<double> to_mandible;
  for (std::size_t i = 0; i < biting.size(); ++i) {
    if (mandible[i].triangle == ClosestHit::kNoTriangle) continue;
    natural.push_back(natural_from_tp * biting[i]);
    to_mandible.push_back(mandible[i].distance_mm);
  }
  const std::vector<ClosestHit> stamp = closest_points(preparation.maxilla, natural, 1.0);
  std::vector<double> error;
  for (std::size_t i = 0; i < natural.size(); ++i) {
    const bool near = stamp[i].triangle != ClosestHit::kNoTriangle;
    error.push_back(std::abs(contact_error(near ? stamp[i].distance_mm : 1.0, to_mandible[i])));
  }
  if (error.empty()) return;
  std::sort(error.begin(), error.end());
  double sum = 0.0;
  for (const double e : error) sum += e;
  out.contact_surface_error = {sum / static_cast<double>(error.size()), error[(error.size() * 99) / 100],
                               error.back(), error.size()};
}

}  // namespace

void verify_contacts(const SplintInputs& inputs, const FinishedSplint& splint, const Preparation& preparation,
                     SplintVerification& out) {
  const std::vector<std::uint8_t> fdi = assign_teeth(inputs.mandible_mi, preparation.arch, Arch::kMandible);
  const Vector3 down = -preparation.arch.up;
  const MeshQuery maxilla(inputs.maxilla);
  const Contacts natural =
      find_contacts(inputs.mandible_mi, fdi, Rigid3::identity(), maxilla, down, preparation.arch, kContactMm);
  const Rigid3 tp = inputs.therapeutic.rigid;
  const MeshQuery splint_dental(transformed(preparation.design_from_dental.inverse(), splint.mesh()));
  out.contacts =
      find_contacts(inputs.mandible_mi, fdi, tp, splint_dental, down, preparation.arch, kContactMm);
  out.natural_contact_area_mm2 = natural.area_mm2;
  out.kept_fraction = kept_fraction(natural, preparation.design_from_dental * tp, splint.query);
  measure_contact_surface(splint, preparation, out);
}

}  // namespace gnathion
