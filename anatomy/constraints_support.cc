// Whether the mandible meets the splint evenly: constraint (d).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "anatomy/constraints.h"
#include "occlusion/crowns.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kOverMm = 1.0;  // the stamp is over what is no farther from it
constexpr double kStepMm = 0.35;

/// Value below which a share of the area lies.
double quantile(const std::vector<std::pair<double, double>>& by_gap, double area, double share) {
  double sum = 0.0;
  for (const auto& [gap, part] : by_gap)
    if ((sum += part) >= share * area) return gap;
  return by_gap.empty() ? 0.0 : by_gap.back().first;
}

/// Of the samples that `which` takes; `room` is what each has over it in TP.
template <class Which>
StampGap stamp_gap(const std::vector<StampSample>& stamp, const std::vector<double>& room,
                   const RealizabilityLimits& limits, Which which) {
  StampGap out;
  std::vector<std::pair<double, double>> by_gap;
  for (std::size_t i = 0; i < stamp.size(); ++i) {
    const StampSample& s = stamp[i];
    if (!which(s)) continue;
    by_gap.emplace_back(s.gap_mm, s.area_mm2);
    out.area_mm2 += s.area_mm2;
    if (s.gap_mm > limits.contact_mm) continue;
    out.contact_mm2 += s.area_mm2;
    if (room[i] >= limits.aperture_mm) out.kept_contact_mm2 += s.area_mm2;
  }
  std::sort(by_gap.begin(), by_gap.end());
  out.p05_mm = quantile(by_gap, out.area_mm2, 0.05);
  out.median_mm = quantile(by_gap, out.area_mm2, 0.5);
  out.p95_mm = quantile(by_gap, out.area_mm2, 0.95);
  return out;
}

using Flat = Eigen::Vector2d;
double cross2(const Flat& o, const Flat& a, const Flat& b) {
  return (a - o).x() * (b - o).y() - (a - o).y() * (b - o).x();
}

struct Corner {
  Flat flat;
  std::size_t index;
};
/// Counter-clockwise (Andrew's monotone chain).
std::vector<Corner> convex_hull(std::vector<Corner> points) {
  std::sort(points.begin(), points.end(), [](const Corner& a, const Corner& b) {
    return a.flat.x() != b.flat.x() ? a.flat.x() < b.flat.x() : a.flat.y() < b.flat.y();
  });
  if (points.size() < 3) return points;
  std::vector<Corner> hull(2 * points.size());
  std::size_t n = 0;
  const auto add = [&](const Corner& p, std::size_t least) {
    while (n >= least && cross2(hull[n - 2].flat, hull[n - 1].flat, p.flat) <= 0.0) --n;
    hull[n++] = p;
  };
  for (const Corner& p : points) add(p, 2);
  const std::size_t lower = n + 1;
  for (std::size_t i = points.size() - 1; i-- > 0;) add(points[i], lower);
  hull.resize(n - 1);
  return hull;
}

/// Distance of a point from the polygon's border, positive inside.
double margin_in(const std::vector<Corner>& hull, const Flat& p) {
  double inside = 1e300, nearest = 1e300;
  for (std::size_t i = 0; i < hull.size(); ++i) {
    const Flat &a = hull[i].flat, &b = hull[(i + 1) % hull.size()].flat;
    const Flat ab = b - a;
    const double length2 = ab.squaredNorm();
    const double t = length2 > 0.0 ? std::clamp((p - a).dot(ab) / length2, 0.0, 1.0) : 0.0;
    nearest = std::min(nearest, (p - a - t * ab).norm());
    if (length2 > 0.0) inside = std::min(inside, cross2(a, b, p) / std::sqrt(length2));
  }
  return hull.size() >= 3 && inside >= 0.0 ? nearest : -nearest;
}

bool is_left(const JawsInTp& jaws, const StampSample& s) {
  return s.fdi != 0 ? fdi_side(s.fdi) > 0 : jaws.arch.to_arch(s.p_mm).x() >= 0.0;
}

/// The hull of the kept contacts as seen along the occlusal normal, in TP.
void find_polygon(const JawsInTp& jaws, const std::vector<double>& room, Support* support) {
  std::vector<Corner> corners;
  for (std::size_t i = 0; i < jaws.stamp.size(); ++i) {
    const StampSample& s = jaws.stamp[i];
    if (s.gap_mm > jaws.limits.contact_mm || room[i] < jaws.limits.aperture_mm) continue;
    const Vector3 in_arch = jaws.arch.to_arch(jaws.therapeutic * s.p_mm);
    corners.push_back({in_arch.head<2>(), i});
  }
  SupportReport& out = support->report;
  const Flat middle = jaws.arch.to_arch(jaws.therapeutic * jaws.arch.origin_mm).head<2>();
  const std::vector<Corner> hull = convex_hull(std::move(corners));
  if (hull.empty()) return;
  for (std::size_t i = 0; i < hull.size(); ++i) {
    out.polygon_mm.push_back(jaws.therapeutic * jaws.stamp[hull[i].index].p_mm);
    out.polygon_mm2 += 0.5 * cross2(hull[0].flat, hull[i].flat, hull[(i + 1) % hull.size()].flat);
  }
  out.margin_mm = margin_in(hull, middle);
}

}  // namespace

std::vector<StampSample> stamp_samples(const MeshQuery& maxilla, const TriangleMesh& mandible_mi,
                                       const std::vector<std::uint8_t>& mandible_fdi, const ArchFrame& arch) {
  // A contact may lie on any side of a cusp, so all of the surface near the maxilla counts, crowns alone.
  const Contacts near =
      find_contacts(mandible_mi, mandible_fdi, Rigid3::identity(), maxilla, -arch.up, arch, kOverMm, kStepMm);
  std::vector<Vector3> points;
  for (const auto& s : near.samples) points.push_back(s.p_mm);
  const std::vector<double> gap =
      signed_gaps_mm(points, Rigid3::identity(), maxilla, -arch.up, kOverMm + kStepMm);
  std::vector<StampSample> out;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::uint8_t fdi = mandible_fdi[near.samples[i].vertex];
    if (gap[i] <= kOverMm) out.push_back({points[i], near.samples[i].area_mm2, gap[i], fdi});
  }
  return out;
}

Support support_in_tp(const JawsInTp& jaws) {
  std::vector<Vector3> points;
  for (const auto& s : jaws.stamp) points.push_back(s.p_mm);
  const std::vector<double> room =
      signed_gaps_mm(points, jaws.therapeutic, jaws.maxilla, -jaws.arch.up, jaws.limits.aperture_mm);
  Support out;
  SupportReport& r = out.report;
  const auto gap = [&](auto which) { return stamp_gap(jaws.stamp, room, jaws.limits, which); };
  r.all = gap([](const StampSample&) { return true; });
  r.front = gap([](const StampSample& s) { return fdi_is_front(s.fdi); });
  r.left = gap([&](const StampSample& s) { return !fdi_is_front(s.fdi) && is_left(jaws, s); });
  r.right = gap([&](const StampSample& s) { return !fdi_is_front(s.fdi) && !is_left(jaws, s); });
  find_polygon(jaws, room, &out);
  for (std::size_t i = 0; i < jaws.stamp.size(); ++i) {
    const StampSample& s = jaws.stamp[i];
    if (s.gap_mm > jaws.limits.contact_mm) continue;
    if (room[i] < jaws.limits.aperture_mm) {
      out.lost_teeth.push_back(s.fdi);
      continue;
    }
    out.centroid_mm += s.area_mm2 * (jaws.therapeutic * s.p_mm);
    (jaws.arch.to_arch(s.p_mm).x() >= 0.0 ? out.left_mm2 : out.right_mm2) += s.area_mm2;
  }
  if (r.all.kept_contact_mm2 > 0.0) out.centroid_mm /= r.all.kept_contact_mm2;
  out.lost_teeth = sorted_teeth(out.lost_teeth);
  return out;
}

Constraint uniform_contact(const JawsInTp& jaws, const Support& support) {
  Constraint c = constraint_of(jaws.table, "uniform_contact");
  const SupportReport& r = support.report;
  const double kept = r.all.kept_contact_mm2;
  c.value = kept > 0.0 ? std::min(support.left_mm2, support.right_mm2) / kept : 0.0;
  c.pass = c.value >= c.limit;
  c.where_mm = support.centroid_mm;
  c.teeth = support.lost_teeth;
  const std::string facts = fmt::format(
      "{:.1f} of {:.1f} mm2 of MI's contact area keep a wall under them: {:.1f} left, {:.1f} in front, "
      "{:.1f} right",
      kept, r.all.contact_mm2, r.left.kept_contact_mm2, r.front.kept_contact_mm2, r.right.kept_contact_mm2);
  c.consequence = c.pass ? facts : "the splint may rock: " + facts;
  return c;
}

Constraint support_polygon(const JawsInTp& jaws, const Support& support) {
  Constraint c = constraint_of(jaws.table, "support_polygon");
  const SupportReport& r = support.report;
  c.where_mm = jaws.therapeutic * jaws.arch.origin_mm;
  if (r.polygon_mm.empty()) {
    c.pass = c.checked = false;
    c.consequence = "no contact keeps a wall under it: nothing carries the mandible";
    return c;
  }
  c.value = r.margin_mm;
  c.pass = c.value >= c.limit;
  c.consequence =
      c.pass ? fmt::format("the arch's middle lies {:.1f} mm inside the {:.0f} mm2 that the contacts span",
                           r.margin_mm, r.polygon_mm2)
             : fmt::format(
                   "the arch's middle lies {:.1f} mm outside the {:.0f} mm2 that the contacts span: a bite "
                   "there tips the splint",
                   -r.margin_mm, r.polygon_mm2);
  return c;
}

}  // namespace gnathion
