// Room between the jaws: constraints (a) and (b).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "anatomy/constraints.h"
#include "core/check.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kFarMm = 60.0;            // as far as distances between jaws are told
constexpr double kOpposedFraction = 0.05;  // less of a tooth under the maxilla says nothing about its side

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

bool is_opposed(const ToothClearance& tooth) {
  return tooth.opposed_fraction >= kOpposedFraction;
}

/// The direction in which the mandible's point at `where` moves away from the maxilla.
Vector3 away_from_maxilla(const JawsInTp& jaws, const Vector3& where_mm) {
  const auto found = jaws.maxilla.signed_distance(where_mm, kFarMm);
  if (!found) return -jaws.arch.up;
  const Vector3 way = where_mm - found->closest.point_mm;
  if (way.norm() < 1e-6) return found->closest.normal;
  return (found->distance_mm < 0.0 ? -1.0 : 1.0) * way.normalized();
}

/// Smallest signed distance between the jaws in TP: negative for overlap, and where the mandible is above.
struct SmallestClearance {
  double value_mm = 0.0;
  Vector3 where_mm = Vector3::Zero();
  bool above = false;
};
SmallestClearance smallest_clearance(const JawsInTp& jaws) {
  const Overlap& tp = jaws.overlap_tp;
  SmallestClearance out{tp.min_distance_mm, tp.closest_mm};
  if (tp.depth_mm > 0.0) {
    out = {-tp.depth_mm, tp.where_mm};
  } else if (tp.min_distance_mm >= Overlap::kSearchMm) {
    out.value_mm = kFarMm;  // farther than the search for overlap looks: told from the teeth
    for (const auto& tooth : jaws.clearances)
      if (tooth.min_mm < out.value_mm) out = {tooth.min_mm, tooth.where_mm};
  }
  for (const auto& tooth : jaws.clearances)
    if (is_opposed(tooth) && tooth.vertical_median_mm < std::min(0.0, out.value_mm))
      out = {tooth.vertical_median_mm, tooth.where_mm, true};
  return out;
}

Constraint clearance_constraint(const JawsInTp& jaws, const char* name) {
  Constraint c = constraint_of(jaws.table, name);
  const SmallestClearance smallest = smallest_clearance(jaws);
  c.value = smallest.value_mm;
  c.where_mm = smallest.where_mm;
  c.pass = c.value >= c.limit;
  c.gradient =
      gradient_at(c.where_mm, smallest.above ? Vector3(-jaws.arch.up) : away_from_maxilla(jaws, c.where_mm));
  if (!c.pass) c.teeth = teeth_closer_than(jaws, c.limit);
  if (!c.pass && c.teeth.empty()) c.teeth = teeth_at(jaws, c.where_mm);
  return c;
}

const ToothOverlap* overlap_of(const std::vector<ToothOverlap>& overlaps, std::uint8_t fdi) {
  for (const auto& o : overlaps)
    if (o.fdi == fdi) return &o;
  return nullptr;
}

double depth_beyond_mi(const JawsInTp& jaws, const ToothOverlap& tp) {
  const ToothOverlap* mi = overlap_of(jaws.tooth_overlap_mi, tp.fdi);
  return std::max(0.0, tp.depth_mm - (mi ? mi->depth_mm : 0.0));
}

/// The tooth of the mandible that is deepest in the maxilla beyond its own depth in MI, where that is more than
/// is accepted: the deepest place of the whole arch may be another one, which MI excuses.
const ToothOverlap* worst_tooth_beyond_mi(const JawsInTp& jaws) {
  const ToothOverlap* worst = nullptr;
  for (const auto& o : jaws.tooth_overlap_tp)
    if (depth_beyond_mi(jaws, o) > jaws.limits.overlap_beyond_mi_mm &&
        (worst == nullptr || depth_beyond_mi(jaws, o) > depth_beyond_mi(jaws, *worst)))
      worst = &o;
  return worst;
}

/// Teeth of both jaws that pass through each other deeper than in MI by more than is accepted.
std::vector<std::uint8_t> teeth_beyond_mi(const JawsInTp& jaws) {
  std::vector<std::uint8_t> teeth;
  for (const auto& o : jaws.tooth_overlap_tp) {
    if (depth_beyond_mi(jaws, o) <= jaws.limits.overlap_beyond_mi_mm) continue;
    for (const auto fdi : teeth_at(jaws, o.where_mm)) teeth.push_back(fdi);
  }
  return sorted_teeth(teeth);
}

}  // namespace

Constraint constraint_of(const std::vector<LimitRow>& table, const std::string& name) {
  const auto row =
      std::find_if(table.begin(), table.end(), [&](const LimitRow& r) { return r.name == name; });
  GNATHION_CHECK(row != table.end());
  Constraint c;
  c.name = name;
  c.limit = row->limit;
  c.unit = row->unit;
  c.at_least = row->at_least;
  c.severity = row->severity;
  return c;
}

Vector6 gradient_at(const Vector3& moved_mm, const Vector3& direction) {
  Vector6 g;
  g << moved_mm.cross(direction), direction;  // d·(ω × p + v)
  return g;
}

Vector6 turn_gradient_deg(const Vector3& axis) {
  Vector6 g;
  g << axis * (180.0 / M_PI), Vector3::Zero();
  return g;
}

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

std::vector<ToothOverlap> tooth_overlaps(const MeshQuery& maxilla, const MeshQuery& mandible,
                                         const std::vector<std::uint8_t>& mandible_fdi, const ArchFrame& arch,
                                         const Rigid3& motion) {
  const Contacts inside = find_contacts(mandible.mesh(), mandible_fdi, motion, maxilla, -arch.up, arch, 0.0);
  std::vector<Vector3> points;
  for (const auto& s : inside.samples) points.push_back(s.p_mm);
  const std::vector<double> gap = signed_gaps_mm(points, motion, maxilla, -arch.up, Overlap::kSearchMm);
  std::map<std::uint8_t, ToothOverlap> teeth;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!(gap[i] < 0.0)) continue;
    ToothOverlap& tooth = teeth[mandible_fdi[inside.samples[i].vertex]];
    tooth.volume_mm3 -= gap[i] * inside.samples[i].area_mm2;
    if (-gap[i] <= tooth.depth_mm) continue;
    tooth.depth_mm = -gap[i];
    tooth.where_mm = motion * points[i];
  }
  std::vector<ToothOverlap> out;
  for (auto& [fdi, tooth] : teeth) {
    tooth.fdi = fdi;
    out.push_back(tooth);
  }
  return out;
}

Constraint mandible_below_maxilla(const JawsInTp& jaws) {
  Constraint c = constraint_of(jaws.table, "mandible_below_maxilla");
  bool any_opposed = false;
  for (const auto& tooth : jaws.clearances) {
    if (!is_opposed(tooth)) continue;
    if (!any_opposed || tooth.vertical_median_mm < c.value) {
      c.value = tooth.vertical_median_mm;
      c.where_mm = tooth.where_mm;
      c.gradient = gradient_at(c.where_mm, -jaws.arch.up);
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

Constraint no_intersection(const JawsInTp& jaws) {
  Constraint c = constraint_of(jaws.table, "no_intersection");
  // Each jaw's surface inside the other is compared with the same of MI; the worse of the two is told.
  const Overlap &mi = jaws.overlap_mi, &tp = jaws.overlap_tp;
  const bool maxilla_worse =
      tp.maxilla_depth_mm - mi.maxilla_depth_mm > tp.mandible_depth_mm - mi.mandible_depth_mm;
  const double in_mi = maxilla_worse ? mi.maxilla_depth_mm : mi.mandible_depth_mm;
  c.value = maxilla_worse ? tp.maxilla_depth_mm : tp.mandible_depth_mm;
  c.limit += in_mi;
  c.pass = c.value <= c.limit;
  if (c.value > 0.0) c.where_mm = tp.where_mm;
  if (const ToothOverlap* tooth = worst_tooth_beyond_mi(jaws); c.pass && tooth != nullptr) {
    c.value = tooth->depth_mm;
    c.limit = tooth->depth_mm - depth_beyond_mi(jaws, *tooth) + jaws.limits.overlap_beyond_mi_mm;
    c.where_mm = tooth->where_mm;
    c.pass = false;
  }
  if (c.value > 0.0) {
    c.gradient = gradient_at(c.where_mm, -away_from_maxilla(jaws, c.where_mm));
    c.teeth = teeth_beyond_mi(jaws);
    if (c.teeth.empty()) c.teeth = teeth_at(jaws, c.where_mm);
  }
  c.consequence =
      c.pass ? fmt::format("the jaws overlap by {:.2f} mm ({:.2f} mm in MI itself)", c.value, mi.depth_mm)
             : fmt::format(
                   "the jaws would pass {:.2f} mm and {:.1f} mm3 through each other ({:.2f} mm and "
                   "{:.1f} mm3 in MI) at {}: this position cannot be taken",
                   c.value, tp.volume_mm3, mi.depth_mm, mi.volume_mm3, listed(c.teeth));
  return c;
}

Constraint interocclusal_clearance(const JawsInTp& jaws) {
  Constraint c = clearance_constraint(jaws, "interocclusal_clearance");
  c.consequence =
      c.pass ? "a wall can stand everywhere between the jaws"
             : fmt::format("no wall can stand at {}: the splint needs apertures there", listed(c.teeth));
  return c;
}

Constraint wall_room(const JawsInTp& jaws) {
  Constraint c = clearance_constraint(jaws, "wall_room");
  c.consequence = c.pass ? "the full wall fits between the jaws"
                         : fmt::format("the wall under the contacts at {} is thinner than {:.1f} mm",
                                       listed(c.teeth), c.limit);
  return c;
}

std::vector<ToothRoom> tooth_rooms(const JawsInTp& jaws) {
  std::vector<ToothRoom> rooms;
  for (const auto& c : jaws.clearances) {
    ToothRoom r;
    r.fdi = c.fdi;
    r.opposing_fdi = c.opposing_fdi;
    r.clearance_mm = c.min_mm;
    r.opposed = is_opposed(c);
    r.vertical_mm = c.vertical_median_mm;
    if (const ToothOverlap* o = overlap_of(jaws.tooth_overlap_tp, c.fdi)) {
      r.clearance_mm = std::min(r.clearance_mm, -o->depth_mm);
      r.overlap_beyond_mi_mm = depth_beyond_mi(jaws, *o);
      r.overlap_mm3 = o->volume_mm3;
    }
    if (r.opposed && r.vertical_mm < 0.0)
      r.room = "none: above the maxilla";
    else if (r.overlap_beyond_mi_mm > jaws.limits.overlap_beyond_mi_mm)
      r.room = "none: intersects";
    else
      r.room = r.clearance_mm < jaws.limits.aperture_mm ? "aperture"
               : r.clearance_mm < jaws.limits.wall_mm   ? "thin wall"
                                                        : "wall";
    rooms.push_back(r);
  }
  return rooms;
}

}  // namespace gnathion
