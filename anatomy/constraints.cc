#include "anatomy/constraints.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kFarMm = 60.0;            // as far as distances between jaws are told
constexpr double kOpposedFraction = 0.05;  // less of a tooth under the maxilla says nothing about its side

std::string listed(const std::vector<std::uint8_t>& teeth) {
  std::string out;
  for (const auto fdi : teeth) out += (out.empty() ? "" : ", ") + std::to_string(fdi);
  return out.empty() ? "no tooth" : out;
}

std::vector<std::uint8_t> sorted_teeth(std::vector<std::uint8_t> teeth) {
  std::sort(teeth.begin(), teeth.end());
  teeth.erase(std::unique(teeth.begin(), teeth.end()), teeth.end());
  if (!teeth.empty() && teeth.front() == 0) teeth.erase(teeth.begin());
  return teeth;
}

/// Mandibular teeth with less room than limit_mm, and the maxillary teeth they come near.
std::vector<std::uint8_t> teeth_closer_than(const JawsInTp& jaws, double limit_mm) {
  std::vector<std::uint8_t> teeth;
  for (const auto& c : jaws.clearances) {
    if (c.min_mm >= limit_mm) continue;
    teeth.push_back(c.fdi);
    teeth.push_back(c.opposing_fdi);
  }
  return sorted_teeth(teeth);
}

/// Teeth of both jaws nearest to a place in TP, no farther than 5 mm.
std::vector<std::uint8_t> teeth_at(const JawsInTp& jaws, const Vector3& where_mm) {
  std::vector<std::uint8_t> teeth;
  auto add = [&](const MeshQuery& jaw, const std::vector<std::uint8_t>& fdi, const Vector3& p) {
    const auto found = jaw.closest(p, 5.0);
    if (!found) return;
    Eigen::Index corner = 0;
    found->barycentric.maxCoeff(&corner);
    teeth.push_back(fdi[jaw.mesh().triangles[found->triangle][static_cast<std::size_t>(corner)]]);
  };
  add(jaws.maxilla, jaws.maxilla_fdi, where_mm);
  add(jaws.mandible, jaws.mandible_fdi, jaws.therapeutic.inverse() * where_mm);
  return sorted_teeth(teeth);
}

/// Smallest signed distance between the jaws in TP: negative for overlap.
struct SmallestClearance {
  double value_mm = 0.0;
  Vector3 where_mm = Vector3::Zero();
};
SmallestClearance smallest_clearance(const JawsInTp& jaws) {
  const Overlap& tp = jaws.overlap_tp;
  if (tp.depth_mm > 0.0) return {-tp.depth_mm, tp.where_mm};
  SmallestClearance out{tp.min_distance_mm, tp.closest_mm};
  if (tp.min_distance_mm < Overlap::kSearchMm) return out;
  out.value_mm = kFarMm;  // farther than the search for overlap looks: told from the teeth
  for (const auto& tooth : jaws.clearances)
    if (tooth.min_mm < out.value_mm) out = {tooth.min_mm, tooth.where_mm};
  return out;
}

/// The contacts that MI has on the mandible, and how much of them keeps room for a wall in TP.
struct KeptContacts {
  double mi_mm2 = 0.0, kept_mm2 = 0.0, left_mm2 = 0.0, right_mm2 = 0.0;
  Vector3 centroid_mm = Vector3::Zero();
  std::vector<std::uint8_t> lost_teeth;
};

KeptContacts kept_contacts(const JawsInTp& jaws, const RealizabilityLimits& limits) {
  const Contacts& mi = jaws.contacts_mi;
  std::vector<Vector3> points;
  for (const auto& s : mi.samples) points.push_back(s.p_mm);
  const auto room = signed_gaps_mm(points, jaws.therapeutic, jaws.maxilla, -jaws.arch.up, limits.aperture_mm);
  KeptContacts out;
  out.mi_mm2 = mi.area_mm2;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const SurfaceSample& s = mi.samples[i];
    if (room[i] < limits.aperture_mm) {
      out.lost_teeth.push_back(jaws.mandible_fdi[s.vertex]);
      continue;
    }
    const Vector3 p = jaws.therapeutic * s.p_mm;
    out.kept_mm2 += s.area_mm2;
    out.centroid_mm += s.area_mm2 * p;
    (jaws.arch.to_arch(s.p_mm).x() >= 0.0 ? out.left_mm2 : out.right_mm2) += s.area_mm2;
  }
  if (out.kept_mm2 > 0.0) out.centroid_mm /= out.kept_mm2;
  out.lost_teeth = sorted_teeth(out.lost_teeth);
  return out;
}

}  // namespace

Constraint mandible_below_maxilla(const JawsInTp& jaws) {
  Constraint c{.name = "mandible_below_maxilla", .limit = 0.0, .unit = "mm"};
  bool any_opposed = false;
  for (const auto& tooth : jaws.clearances) {
    if (tooth.opposed_fraction < kOpposedFraction) continue;
    if (!any_opposed || tooth.vertical_median_mm < c.value) {
      c.value = tooth.vertical_median_mm;
      c.where_mm = tooth.where_mm;
    }
    any_opposed = true;
    if (tooth.vertical_median_mm < 0.0) c.teeth.push_back(tooth.fdi);
  }
  c.pass = any_opposed && c.teeth.empty();
  if (!any_opposed)
    c.consequence = "no tooth of the mandible has the maxilla over it: a splint would hold nothing";
  else if (!c.pass)
    c.consequence =
        fmt::format("the mandible lies above the maxilla at {}: no splint fits between", listed(c.teeth));
  else
    c.consequence = "the mandible is below the maxilla at every tooth";
  return c;
}

Constraint no_intersection(const JawsInTp& jaws, const RealizabilityLimits& limits) {
  Constraint c{.name = "no_intersection", .unit = "mm"};
  // Each jaw's surface inside the other is compared with the same of MI; the worse of the two is told.
  const Overlap &mi = jaws.overlap_mi, &tp = jaws.overlap_tp;
  const bool maxilla_worse =
      tp.maxilla_depth_mm - mi.maxilla_depth_mm > tp.mandible_depth_mm - mi.mandible_depth_mm;
  const double in_mi = maxilla_worse ? mi.maxilla_depth_mm : mi.mandible_depth_mm;
  c.value = maxilla_worse ? tp.maxilla_depth_mm : tp.mandible_depth_mm;
  c.limit = in_mi + limits.overlap_beyond_mi_mm;
  c.pass = c.value <= c.limit;
  if (c.value > 0.0) {
    c.where_mm = jaws.overlap_tp.where_mm;
    c.teeth = teeth_at(jaws, c.where_mm);
  }
  c.consequence =
      c.pass ? fmt::format("the jaws overlap by {:.2f} mm ({:.2f} mm in MI itself)", c.value,
                           jaws.overlap_mi.depth_mm)
             : fmt::format(
                   "the jaws would pass {:.2f} mm through each other over {:.0f} mm2 at {}: this position "
                   "cannot be taken",
                   c.value, jaws.overlap_tp.area_mm2, listed(c.teeth));
  return c;
}

Constraint interocclusal_clearance(const JawsInTp& jaws, const RealizabilityLimits& limits) {
  Constraint c{.name = "interocclusal_clearance", .unit = "mm", .severity = Severity::kApertures};
  const SmallestClearance smallest = smallest_clearance(jaws);
  c.value = smallest.value_mm;
  c.where_mm = smallest.where_mm;
  c.limit = limits.aperture_mm;
  c.pass = c.value >= c.limit;
  if (!c.pass) c.teeth = teeth_closer_than(jaws, c.limit);
  if (!c.pass && c.teeth.empty()) c.teeth = teeth_at(jaws, c.where_mm);
  c.consequence =
      c.pass ? "a wall can stand everywhere between the jaws"
             : fmt::format("no wall can stand at {}: the splint needs apertures there", listed(c.teeth));
  return c;
}

Constraint wall_room(const JawsInTp& jaws, const RealizabilityLimits& limits) {
  Constraint c{.name = "wall_room", .unit = "mm", .severity = Severity::kInforms};
  const SmallestClearance smallest = smallest_clearance(jaws);
  c.value = smallest.value_mm;
  c.where_mm = smallest.where_mm;
  c.limit = limits.wall_mm;
  c.pass = c.value >= c.limit;
  if (!c.pass) c.teeth = teeth_closer_than(jaws, c.limit);
  c.consequence = c.pass ? "the full wall fits between the jaws"
                         : fmt::format("the wall under the contacts at {} is thinner than {:.1f} mm",
                                       listed(c.teeth), c.limit);
  return c;
}

std::vector<Constraint> reachable_from_mi(const ArchFrame& arch, const Rigid3& therapeutic,
                                          const RealizabilityLimits& limits) {
  const Matrix3& to_arch = arch.arch_from_dental.rotation;
  const Vector3 turn_deg = to_arch * log_so3(therapeutic.rotation) * (180.0 / 3.14159265358979323846);
  const double slack_mm = limits.condyle_uncertainty_mm * therapeutic.angle_rad();
  auto moved = [&](const Vector3& p) -> Vector3 { return to_arch * (therapeutic * p - p); };
  const Vector3 between_condyles =
      arch.incisal_mm - limits.condyle_behind_mm * arch.anterior + limits.condyle_above_mm * arch.up;
  const Vector3 condyles[2] = {between_condyles + limits.condyle_half_distance_mm * arch.left,
                               between_condyles - limits.condyle_half_distance_mm * arch.left};
  const Vector3 incisal = moved(arch.incisal_mm), left = moved(condyles[0]), right = moved(condyles[1]);

  std::vector<Constraint> out;
  auto check = [&](const char* name, double value, double limit, const char* unit, const Vector3& where,
                   const char* otherwise) {
    const bool pass = value <= limit;
    out.push_back({.name = name,
                   .value = value,
                   .limit = limit,
                   .unit = unit,
                   .pass = pass,
                   .where_mm = therapeutic * where,
                   .consequence = pass ? "within the mandible's usual range" : otherwise});
  };
  // Of two condyles, the one that goes farther along an arch direction.
  auto worse = [&](int axis, double sign) {
    const bool first = sign * left(axis) >= sign * right(axis);
    return std::pair<double, Vector3>(sign * (first ? left : right)(axis), condyles[first ? 0 : 1]);
  };
  check("opening_rotation", turn_deg.x(), limits.opening_deg, "deg", arch.incisal_mm,
        "the mandible would have to open wider than it can");
  check("closing_rotation", 0.0 - turn_deg.x(), limits.closing_deg, "deg", arch.incisal_mm,
        "the front teeth would have to close past MI");
  check("yaw", std::abs(turn_deg.z()), limits.yaw_deg, "deg", arch.origin_mm,
        "asymmetric: one joint would be pressed back, the other pulled out");
  check("roll", std::abs(turn_deg.y()), limits.roll_deg, "deg", arch.origin_mm,
        "asymmetric: one joint would be pulled apart, the other compressed");
  check("vertical_opening", -incisal.z(), limits.vertical_opening_mm, "mm", arch.incisal_mm,
        "the splint would be too thick to be worn");
  check("protrusion", -incisal.y(), limits.protrusion_mm, "mm", arch.incisal_mm,
        "the mandible would have to come farther forward than it can");
  check("laterotrusion", std::abs(incisal.x()), limits.laterotrusion_mm, "mm", arch.incisal_mm,
        "the mandible would have to go farther to the side than it can");
  const auto [forward_mm, forward_at] = worse(1, -1.0);
  check("condyle_forward", forward_mm, limits.condyle_forward_mm + slack_mm, "mm", forward_at,
        "a condyle would leave its joint forwards");
  const auto [back_mm, back_at] = worse(1, 1.0);
  check("condyle_back", back_mm, limits.condyle_back_mm + slack_mm, "mm", back_at,
        "a condyle would be pressed back out of its fossa: the joint would be overloaded");
  const auto [up_mm, up_at] = worse(2, 1.0);
  check("condyle_up", up_mm, limits.condyle_up_mm + slack_mm, "mm", up_at,
        "a condyle would be pressed into the roof of its fossa");
  const auto [down_mm, down_at] = worse(2, -1.0);
  check("condyle_down", down_mm, limits.condyle_down_mm + slack_mm, "mm", down_at,
        "a condyle would be pulled out of its joint");
  check("condyle_lateral", std::abs(0.5 * (left.x() + right.x())), limits.condyle_lateral_mm + slack_mm, "mm",
        between_condyles, "both condyles would have to shift sideways farther than joints allow");
  return out;
}

Constraint uniform_contact(const JawsInTp& jaws, const RealizabilityLimits& limits) {
  const KeptContacts kept = kept_contacts(jaws, limits);
  Constraint c{.name = "uniform_contact",
               .limit = limits.weaker_side_share,
               .unit = "share",
               .severity = Severity::kInforms};
  c.value = kept.kept_mm2 > 0.0 ? std::min(kept.left_mm2, kept.right_mm2) / kept.kept_mm2 : 0.0;
  c.pass = c.value >= c.limit;
  c.where_mm = kept.centroid_mm;
  c.teeth = kept.lost_teeth;
  const std::string facts = fmt::format(
      "{:.1f} of {:.1f} mm2 of MI's contact area keep a wall under them, {:.1f} left and {:.1f} right",
      kept.kept_mm2, kept.mi_mm2, kept.left_mm2, kept.right_mm2);
  c.consequence = c.pass ? facts : "the splint may rock: " + facts;
  return c;
}

Constraint joints_not_checked() {
  return {.name = "condyle_fossa",
          .unit = "mm",
          .checked = false,
          .severity = Severity::kInforms,
          .consequence = "joints not checked: no CBCT"};
}

}  // namespace gnathion
