#include "design/gates.h"

#include <algorithm>

namespace gnathion {
namespace {

constexpr double kPenetrationMm = 0.02;
constexpr double kExcursionMm = 0.15;  // the coarse sweep of the opposing arch is good to about 0.1
constexpr double kSeatingMm = 0.02, kSeatingDeg = 0.05;
constexpr double kFlatTeeth = 4.0;              // a flat splint that fewer teeth touch rocks
constexpr double kInsertionToleranceMm = 0.02;  // as deep as surfaces at rest may be in each other
constexpr double kUndercutMm = 0.05;            // of the imprint to the opening path
constexpr double kLocksMm = 0.1;                // the same, past what the coarse sweep may miss
constexpr double kWallToleranceMm = 0.02;       // of triangles at 0.1 mm voxels
constexpr double kTouchesMm2 = 0.1;             // a positioning splint that touches less holds no jaw ...
constexpr double kKept = 0.95;                  // of MI's contact area outside apertures
constexpr double kNaturalMm2 = 0.5;             // ... where MI's contacts are more than a scan's noise

Gate at_most(const std::string& name, double value, double limit, bool blocks = true) {
  return {name, value, limit, value <= limit, blocks};
}
Gate at_least(const std::string& name, double value, double limit, bool blocks = true) {
  return {name, value, limit, value >= limit, blocks};
}

}  // namespace

std::vector<Gate> splint_gates(const SplintVerification& v, const SplintParameters& p,
                               double side_wall_p01_mm) {
  const auto count = [](std::size_t n) { return static_cast<double>(n); };
  std::vector<Gate> gates;
  gates.push_back(at_most("open_edges", count(v.topology.boundary_edges), 0));
  gates.push_back(
      at_most("non_manifold", count(v.topology.non_manifold_edges + v.topology.non_manifold_vertices), 0));
  const std::size_t pieces = pieces_of(p);
  gates.push_back(
      {"components", count(v.topology.components), count(pieces), v.topology.components == pieces, true});
  gates.push_back(at_most("self_intersections", count(v.self_intersections), 0));
  gates.push_back(at_most("maxilla_penetration_mm", v.maxilla_penetration_mm, kPenetrationMm));
  gates.push_back(at_most("mandible_penetration_mm", v.mandible_penetration_mm, kPenetrationMm));
  gates.push_back(at_least("wall_min_mm", v.thickness.min_mm, p.aperture_limit_mm - kWallToleranceMm));
  gates.push_back(at_least("side_wall_p01_mm", side_wall_p01_mm, p.wall_mm - kWallToleranceMm));
  gates.push_back(
      at_most("insertability_mm", v.insertability.deepest_mm, p.engagement_mm + kInsertionToleranceMm));
  const bool flat = is_flat(p);  // has no natural relief and no contacts of MI to compare with
  if (flat)
    gates.push_back(at_least("flat_touching_teeth", count(v.contacts.per_tooth.size()), kFlatTeeth, false));
  if (!flat) gates.push_back(at_most("imprint_depth_mm", v.imprint.depth_mm, p.imprint_depth_mm, false));
  if (!flat)
    gates.push_back(at_most("imprint_depth_avoidable_mm", v.imprint.avoidable_mm, p.imprint_depth_mm));
  gates.push_back(at_most("imprint_undercut_mm", v.imprint.undercut_mm, kUndercutMm, false));
  gates.push_back(at_most("imprint_locks_mm", v.imprint.undercut_mm, kLocksMm));
  if (v.freedom) gates.push_back(at_most("excursions_depth_mm", v.freedom->deepest_mm, kExcursionMm));
  if (!v.seating_note.empty()) gates.push_back({"predicted_seating_at_rest", 0.0, 1.0, false, false});
  if (v.predicted_seating && !flat) {
    gates.push_back(at_most("predicted_seating_t_mm", v.predicted_seating->t_mm, kSeatingMm, false));
    gates.push_back(
        at_most("predicted_seating_alpha_deg", v.predicted_seating->alpha_deg, kSeatingDeg, false));
  }
  gates.push_back(at_most("contact_surface_p99_mm", v.contact_surface_error.p99_mm, 0.02, false));
  if (!flat && v.natural_contact_area_mm2 >= kNaturalMm2)
    gates.push_back(at_least("contacts_mm2", v.contacts.area_mm2, kTouchesMm2));
  gates.push_back(at_least("contacts_left_mm2", v.contacts.left_area_mm2, 0.1, false));
  gates.push_back(at_least("contacts_right_mm2", v.contacts.right_area_mm2, 0.1, false));
  if (!flat) gates.push_back(at_least("contacts_kept_fraction", v.kept_outside_apertures, kKept, false));
  return gates;
}

Gate flat_tip_gate(const FlatPlane& plane, const SplintParameters& p) {
  double deepest = 0.0;
  for (const FlatPlane::Tip& tip : plane.tips()) deepest = std::max(deepest, tip.into_mm);
  return at_most("flat_tip_depth_mm", deepest, p.plane_indent_mm + kFlatTipToleranceMm, false);
}

}  // namespace gnathion
