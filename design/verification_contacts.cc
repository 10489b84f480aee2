#include <algorithm>
#include <cmath>

#include "design/verification_steps.h"

namespace gnathion {
namespace {

constexpr double kContactMm = 0.05;

/// Parts of the natural contact area that touch the splint in TP: of all, and of what is farther than
/// `aperture_mm` from the support there, where a wall can stand.
void measure_kept(const Contacts& natural, const Rigid3& design_tp_from_dental, const MeshQuery& splint,
                  const MeshQuery& support, double aperture_mm, SplintVerification& out) {
  std::vector<Vector3> points;
  for (const SurfaceSample& s : natural.samples) points.push_back(design_tp_from_dental * s.p_mm);
  const std::vector<ClosestHit> hits = closest_points(splint, points, kContactMm);
  const std::vector<ClosestHit> teeth = closest_points(support, points, aperture_mm);
  double kept = 0.0, total = 0.0, kept_outside = 0.0, total_outside = 0.0;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    const double area = natural.samples[i].area_mm2;
    const double touching = hits[i].triangle != ClosestHit::kNoTriangle ? area : 0.0;
    total += area;
    kept += touching;
    if (teeth[i].triangle != ClosestHit::kNoTriangle) continue;
    total_outside += area;
    kept_outside += touching;
  }
  out.kept_fraction = total > 0.0 ? kept / total : 0.0;
  out.kept_outside_apertures = total_outside > 0.0 ? kept_outside / total_outside : 0.0;
}

/// How far a point of the splint near the opposing arch is from the surface of S_occ in TP less that arch.
double contact_error(double stamp_mm, double opposing_mm) {
  const double outside = std::max(stamp_mm, -opposing_mm);
  return outside > 0.0 ? outside : std::min(-stamp_mm, opposing_mm);
}

void measure_contact_surface(const FinishedSplint& splint, const Preparation& preparation,
                             SplintVerification& out) {
  const Rigid3 natural_from_tp = preparation.tp_from_mi.inverse();
  std::vector<Vector3> biting, near_opposing, natural;
  for (std::size_t v = 0; v < splint.parts.size(); ++v)
    if (splint.parts[v] == SurfacePart::kImprint || splint.parts[v] == SurfacePart::kStamp)
      biting.push_back(splint.mesh().vertices_mm[v]);
  const std::vector<ClosestHit> opposing = closest_points(preparation.opposing, biting, kContactMm);
  std::vector<double> to_opposing;
  for (std::size_t i = 0; i < biting.size(); ++i) {
    if (opposing[i].triangle == ClosestHit::kNoTriangle) continue;
    near_opposing.push_back(biting[i]);
    natural.push_back(natural_from_tp * biting[i]);
    to_opposing.push_back(opposing[i].distance_mm);
  }
  const std::vector<ClosestHit> stamp = closest_points(preparation.stamp_source(), natural, 1.0);
  std::vector<double> error;
  for (std::size_t i = 0; i < natural.size(); ++i) {
    const bool near = stamp[i].triangle != ClosestHit::kNoTriangle;
    const double stamp_mm = preparation.flat ? preparation.flat->beyond_mm(near_opposing[i])
                            : near           ? stamp[i].distance_mm
                                             : 1.0;
    error.push_back(std::abs(contact_error(stamp_mm, to_opposing[i])));
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
                     const SplintParameters& p, SplintVerification& out) {
  const TriangleMesh& opposing = inputs.opposing_mi();
  const std::vector<std::uint8_t>& fdi = preparation.opposing_fdi;
  const Vector3 away = -preparation.arch.gingival(inputs.arch);
  const Rigid3 dental = preparation.design_from_dental.inverse();
  const MeshQuery natural_surface(
      inputs.occlusal_surface ? transformed(dental, preparation.stamp_source().mesh()) : inputs.support());
  const Contacts natural =
      find_contacts(opposing, fdi, Rigid3::identity(), natural_surface, away, preparation.arch, kContactMm);
  const Rigid3 tp = inputs.opposing_motion();
  // Asked in the design frame, where the splint's tree stands.
  const Rigid3& design = preparation.design_from_dental;
  ArchFrame arch = preparation.arch;
  arch.arch_from_dental = arch.arch_from_dental * dental;
  out.contacts =
      find_contacts(opposing, fdi, design * tp, splint.query, design.rotation * away, arch, kContactMm);
  for (ContactPatch& patch : out.contacts.patches) patch.centre_mm = dental * patch.centre_mm;
  if (inputs.therapeutic_covariance)
    out.contact_sigma = contact_sigmas(out.contacts, opposing, fdi, inputs.therapeutic.rigid,
                                       inputs.on_maxilla(), *inputs.therapeutic_covariance);
  out.natural_contact_area_mm2 = natural.area_mm2;
  // The wall ends at the cavity, which leaves the teeth the gap.
  measure_kept(natural, preparation.design_from_dental * tp, splint.query, preparation.support,
               p.aperture_limit_mm + std::max(p.gap_mm, p.stop_gap_mm), out);
  measure_contact_surface(splint, preparation, out);
}

}  // namespace gnathion
