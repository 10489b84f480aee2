#include "design/retention.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <nlohmann/json.hpp>

#include "design/parallel.h"
#include "design/solid_distance.h"
#include "design/verification_steps.h"
#include "occlusion/point_grid.h"

namespace gnathion {
namespace {

constexpr double kBandMm = 9.0;      // crowns lie this near to the arch curve
constexpr double kRetentive = 0.05;  // of the normal's length along a: steeper than 3°
constexpr double kReachMm = 1.5;
constexpr double kToothMm = 2.0;  // from a place of the cavity to the vertex that names the tooth
constexpr double kAboutMm = 0.6;  // around the height where the coarse sweep found the bulge ...
constexpr double kStepMm = 0.1;   // ... it is measured this finely

std::vector<float> undercuts(const SplintField& field, const TriangleMesh& support_dental) {
  const Preparation& prep = field.preparation();
  std::vector<float> out(support_dental.vertices_mm.size(), 0.0f);
  parallel_each(out.size(), [&](std::size_t v) {
    const Vector3 p = prep.design_from_dental * support_dental.vertices_mm[v];
    if (std::abs(prep.level.off_curve_mm(p)) > kBandMm ||
        p.z() > prep.cut_mm(p, field.parameters().depth_mm) || prep.level.beyond_cover_mm(p) > 0.0)
      return;
    // p lies on M, so the solid's own interpolated distance there is the interpolation's error.
    const double depth = field.jaws().support.linear(p) - field.jaws().support_swept.linear(p);
    if (depth > kUndercutShownMm) out[v] = static_cast<float>(depth);
  });
  return out;
}

/// How deep a point of the cavity stands in the solid that the arch sweeps along a.
double engaged_mm(const SplintField& field, const Vector3& p) {
  const Preparation& prep = field.preparation();
  const GridCell cell = located(prep.coarse, p);
  double least = 1e9, before = 1e9;
  for (int corner = 0; corner < 4; ++corner) {
    const double z = field.jaws().swept_from.at(cell.index.x() + (corner & 1), cell.index.y() + (corner >> 1),
                                                cell.index.z());
    if (std::abs(z - before) < 0.5 * prep.coarse.spacing_mm) continue;
    before = z;
    for (double off = -kAboutMm; off <= kAboutMm; off += kStepMm)
      if (const auto d = solid_distance(prep.support, {p.x(), p.y(), std::min(p.z(), z + off)}, kReachMm))
        least = std::min(least, d->distance_mm);
  }
  return least > 1e8 ? 0.0 : std::max(0.0, -least);
}

/// What touches the retentive sides of the teeth.
void add_engagement(const FinishedSplint& splint, const SplintField& field,
                    const TriangleMesh& support_dental, const std::vector<std::uint8_t>& support_fdi,
                    std::map<std::uint8_t, ToothRetention>& teeth) {
  const TriangleMesh cavity = splint.region({SurfacePart::kCavity});
  std::vector<std::size_t> retentive;
  for (std::size_t t = 0; t < cavity.triangles.size(); ++t) {
    const Vector3 scaled = face_normal_scaled(cavity, t);
    if (scaled.z() < -kRetentive * scaled.norm()) retentive.push_back(t);
  }
  std::vector<std::uint8_t> named_fdi;
  std::vector<Vector3> named;
  for (std::size_t v = 0; v < support_fdi.size(); ++v)
    if (support_fdi[v] != 0) {
      named.push_back(field.preparation().design_from_dental * support_dental.vertices_mm[v]);
      named_fdi.push_back(support_fdi[v]);
    }
  const NeighbourGrid grid(std::move(named), 1.0);
  std::vector<double> depth(retentive.size(), 0.0);
  std::vector<std::uint8_t> tooth(retentive.size(), 0);
  parallel_each(retentive.size(), [&](std::size_t i) {
    const std::size_t t = retentive[i];
    const Vector3 centre = (cavity.corner(t, 0) + cavity.corner(t, 1) + cavity.corner(t, 2)) / 3.0;
    if (const auto near = grid.nearest(centre, kToothMm)) tooth[i] = named_fdi[*near];
    depth[i] = engaged_mm(field, centre);
  });
  for (std::size_t i = 0; i < retentive.size(); ++i) {
    if (tooth[i] == 0) continue;
    ToothRetention& r = teeth[tooth[i]];
    r.engaged_area_mm2 += 0.5 * face_normal_scaled(cavity, retentive[i]).norm();
    r.engaged_max_mm = std::max(r.engaged_max_mm, depth[i]);
  }
}

}  // namespace

double Retention::undercut_max_mm() const {
  double most = 0.0;
  for (const ToothRetention& t : per_tooth) most = std::max(most, t.undercut_max_mm);
  return most;
}
double Retention::engaged_max_mm() const {
  double most = 0.0;
  for (const ToothRetention& t : per_tooth) most = std::max(most, t.engaged_max_mm);
  return most;
}
double Retention::engaged_area_mm2() const {
  double sum = 0.0;
  for (const ToothRetention& t : per_tooth) sum += t.engaged_area_mm2;
  return sum;
}

void measure_retention(const FinishedSplint& splint, const SplintField& field,
                       const TriangleMesh& support_dental, const std::vector<std::uint8_t>& support_fdi,
                       Retention& out) {
  out.undercut_mm = undercuts(field, support_dental);
  std::map<std::uint8_t, ToothRetention> teeth;
  const Preparation& prep = field.preparation();
  for (std::size_t t = 0; t < support_dental.triangles.size(); ++t) {
    const Triangle& corners = support_dental.triangles[t];
    const std::uint8_t fdi = support_fdi[corners[0]];
    const Vector3 p = prep.design_from_dental * support_dental.vertices_mm[corners[0]];
    if (fdi == 0 || prep.level.beyond_cover_mm(p) > 0.0) continue;
    ToothRetention& tooth = teeth[fdi];
    double mean = 0.0;
    for (const std::uint32_t v : corners) {
      tooth.undercut_max_mm = std::max<double>(tooth.undercut_max_mm, out.undercut_mm[v]);
      mean += out.undercut_mm[v] / 3.0;
    }
    if (mean > kUndercutShownMm)
      tooth.undercut_area_mm2 += 0.5 * face_normal_scaled(support_dental, t).norm();
  }
  add_engagement(splint, field, support_dental, support_fdi, teeth);
  out.per_tooth.clear();
  for (auto& [fdi, tooth] : teeth) {
    tooth.fdi = fdi;
    out.per_tooth.push_back(tooth);
  }
}

nlohmann::json retention_json(const Retention& retention) {
  nlohmann::json teeth = nlohmann::json::array();
  for (const ToothRetention& t : retention.per_tooth)
    teeth.push_back({{"fdi", t.fdi},
                     {"undercut_max_mm", t.undercut_max_mm},
                     {"undercut_area_mm2", t.undercut_area_mm2},
                     {"engaged_max_mm", t.engaged_max_mm},
                     {"engaged_area_mm2", t.engaged_area_mm2}});
  return {{"undercut_max_mm", retention.undercut_max_mm()},
          {"engaged_max_mm", retention.engaged_max_mm()},
          {"engaged_area_mm2", retention.engaged_area_mm2()},
          {"per_tooth", teeth}};
}

}  // namespace gnathion
