#include <algorithm>
#include <cmath>

#include "design/parallel.h"
#include "design/verification_steps.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kContactMm = 0.05;

/// Part of the natural contact area that touches the splint in TP.
double kept_fraction(const Contacts& natural, const Rigid3& design_tp_from_dental, const MeshQuery& splint) {
  std::vector<double> kept(natural.samples.size(), 0.0);
  parallel_each(kept.size(), [&](std::size_t i) {
    const SurfaceSample& s = natural.samples[i];
    if (splint.closest(design_tp_from_dental * s.p_mm, kContactMm)) kept[i] = s.area_mm2;
  });
  double sum = 0.0, total = 0.0;
  for (std::size_t i = 0; i < kept.size(); ++i) {
    sum += kept[i];
    total += natural.samples[i].area_mm2;
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
  const auto& vertices = splint.mesh().vertices_mm;
  std::vector<double> error(vertices.size(), -1.0);
  parallel_each(vertices.size(), [&](std::size_t v) {
    if (splint.parts[v] != SurfacePart::kImprint && splint.parts[v] != SurfacePart::kStamp) return;
    const auto mandible = preparation.mandible.signed_distance(vertices[v], kContactMm);
    if (!mandible) return;
    const auto stamp = preparation.maxilla.signed_distance(natural_from_tp * vertices[v], 1.0);
    error[v] = std::abs(contact_error(stamp ? stamp->distance_mm : 1.0, mandible->distance_mm));
  });
  error.erase(std::remove(error.begin(), error.end(), -1.0), error.end());
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
