// Cuts an arch into teeth: where the walls of neighbouring crowns turn from facing distally to facing
// mesially lies an interdental boundary; dynamic programming chooses the set of boundaries that suits the
// usual widths of teeth.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "occlusion/crowns.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kBinMm = 0.25;
constexpr double kMarginMm = 3.0;        // the profile reaches past the ends of the curve
constexpr double kProfileDepthMm = 4.5;  // of crown behind the local occlusal level that is looked at
constexpr double kBandMm = 7.0;          // buccal and lingual of the arch curve
constexpr double kTopDepthMm = 3.0;
// Weights of the programme; a clear interdental boundary scores about 1.
constexpr double kWidthSpread = 0.15;  // relative; one such deviation costs kWidthCost
constexpr double kWidthCost = 0.25;
constexpr double kScaleSpread = 0.08;  // of all the teeth's widths together
constexpr double kMidlineSpreadMm = 2.5;
constexpr double kUncoveredCostPerMm = 0.12;
constexpr double kToplessCostPerMm = 0.15;    // length of a tooth without crown tops: tuberosity, gap
constexpr double kCrownInGapCostPerMm = 0.6;  // crown tops where a tooth is said to be missing: another's
constexpr double kEndWeight = 0.4;            // of the last distal wall: a cast's cut back looks like one
constexpr double kThirdMolarCost = 1.0;
constexpr double kMissingMolarCost = 1.0;

/// What the crowns show along the arch, per bin.
struct Profile {
  double s0_mm = 0.0;
  std::vector<double> valley;       ///< turn of the walls' facing: about 1 at a boundary
  std::vector<double> left_end;     ///< how much the walls just before s face the left end
  std::vector<double> right_end;    ///< how much the walls just after s face the right end
  std::vector<double> tops_before;  ///< length of crown tops before s, mm
  std::size_t size() const { return valley.size(); }
  double s_mm(std::size_t bin) const { return s0_mm + kBinMm * static_cast<double>(bin); }
};

std::vector<double> vertex_areas(const TriangleMesh& mesh) {
  std::vector<double> area(mesh.vertices_mm.size(), 0.0);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const auto v : mesh.triangles[t]) area[v] += face_normal_scaled(mesh, t).norm() / 6.0;
  return area;
}

/// Mean of `sum`/`area` over bins [from, to] relative to `bin`; 0 where there is too little surface.
double window_mean(const std::vector<double>& sum, const std::vector<double>& area, std::ptrdiff_t bin,
                   std::ptrdiff_t from, std::ptrdiff_t to) {
  double s = 0.0, a = 0.0;
  for (std::ptrdiff_t k = bin + from; k <= bin + to; ++k) {
    if (k < 0 || k >= static_cast<std::ptrdiff_t>(sum.size())) continue;
    s += sum[static_cast<std::size_t>(k)];
    a += area[static_cast<std::size_t>(k)];
  }
  return a > 1.0 ? s / a : 0.0;  // mm² in a window of 1.75 mm: less is no crown
}

Profile crown_profile(const TriangleMesh& mesh, const ArchFrame& own, Arch which) {
  const ArchRuler ruler(own);
  const OcclusalLevel level(mesh, own, which);
  const auto normals = vertex_normals(mesh);
  const auto areas = vertex_areas(mesh);
  std::vector<ArchCoordinates> at(normals.size());
  std::vector<double> along(normals.size());
  tbb::parallel_for(std::size_t{0}, at.size(), [&](std::size_t i) {
    at[i] = ruler.measure(mesh.vertices_mm[i]);
    along[i] = normals[i].dot(ruler.tangent(at[i].s_mm));
  });

  Profile out;
  out.s0_mm = ruler.s_min_mm() - kMarginMm;
  const auto bins =
      static_cast<std::size_t>((ruler.s_max_mm() - ruler.s_min_mm() + 2.0 * kMarginMm) / kBinMm) + 1;
  std::vector<double> facing(bins, 0.0), area(bins, 0.0), tops(bins, 0.0);
  const Vector3 towards_opposing = -own.gingival(which);
  for (std::size_t i = 0; i < at.size(); ++i) {
    const double bin = std::round((at[i].s_mm - out.s0_mm) / kBinMm);
    if (bin < 0.0 || bin >= static_cast<double>(bins) || std::abs(at[i].buccal_mm) > kBandMm) continue;
    const double depth = which == Arch::kMaxilla ? at[i].height_mm : -at[i].height_mm;
    if (depth > level.depth_mm(at[i].s_mm) + kProfileDepthMm) continue;
    const auto b = static_cast<std::size_t>(bin);
    facing[b] += areas[i] * along[i];
    area[b] += areas[i];
    if (depth < kTopDepthMm && normals[i].dot(towards_opposing) > 0.5) tops[b] += areas[i];
  }
  double before = 0.0;
  for (std::size_t b = 0; b < bins; ++b) {
    const auto k = static_cast<std::ptrdiff_t>(b);
    const double ahead = window_mean(facing, area, k, 1, 7), behind = window_mean(facing, area, k, -7, -1);
    out.valley.push_back(behind - ahead);
    out.left_end.push_back(behind);
    out.right_end.push_back(-ahead);
    out.tops_before.push_back(before);
    if (tops[b] > 0.25) before += kBinMm;  // at least 1 mm of breadth
  }
  return out;
}

double width_cost(double width_mm, double usual_mm) {
  const double deviation = (width_mm - usual_mm) / (kWidthSpread * usual_mm);
  return kWidthCost * deviation * deviation;
}

/// What is told about each tooth by hand, in the order of the partition.
struct Told {
  bool missing = false;
  std::vector<double> at_mm;  ///< arc lengths that lie on this tooth
};

std::vector<Told> told_of(const std::vector<std::uint8_t>& fdi, const ToothCorrections& corrections,
                          const ArchRuler& ruler) {
  std::vector<Told> out(fdi.size());
  for (std::size_t k = 0; k < fdi.size(); ++k) {
    out[k].missing = std::find(corrections.missing.begin(), corrections.missing.end(), fdi[k]) !=
                     corrections.missing.end();
    for (const ToothCorrections::Label& label : corrections.labels)
      if (label.fdi == fdi[k]) out[k].at_mm.push_back(ruler.measure(label.at_mm).s_mm);
  }
  return out;
}

/// Whether a label is for a tooth of this arch that the set does not have.
bool leaves_out(const std::vector<std::uint8_t>& fdi, const ToothCorrections& corrections, Arch which) {
  const std::vector<std::uint8_t> all = fdi_order(which);
  return std::any_of(corrections.labels.begin(), corrections.labels.end(), [&](const auto& label) {
    return std::find(all.begin(), all.end(), label.fdi) != all.end() &&
           std::find(fdi.begin(), fdi.end(), label.fdi) == fdi.end();
  });
}

/// Best boundaries for a given set of teeth and a given common scale of widths.
std::optional<ToothPartition> best_cut(const Profile& profile, const std::vector<std::uint8_t>& fdi,
                                       const std::vector<Told>& told, double scale) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const std::size_t n = profile.size(), teeth = fdi.size();
  const auto midline = static_cast<std::size_t>(
      std::count_if(fdi.begin(), fdi.end(), [](std::uint8_t f) { return fdi_side(f) < 0; }));
  std::vector<double> cost(n);
  for (std::size_t i = 0; i < n; ++i)
    cost[i] = kUncoveredCostPerMm * profile.tops_before[i] - kEndWeight * profile.right_end[i];
  std::vector<std::vector<std::uint32_t>> came_from(teeth, std::vector<std::uint32_t>(n, 0));

  for (std::size_t k = 0; k < teeth; ++k) {
    const double usual = scale * mean_crown_width_mm(fdi[k]);
    const bool missing = told[k].missing;
    const auto narrowest = missing ? std::size_t{0} : static_cast<std::size_t>(0.6 * usual / kBinMm);
    const auto widest = static_cast<std::size_t>(1.5 * usual / kBinMm);
    const auto holds = [&](std::size_t from, std::size_t to) {
      return std::all_of(told[k].at_mm.begin(), told[k].at_mm.end(),
                         [&](double s) { return profile.s_mm(from) <= s && s < profile.s_mm(to); });
    };
    std::vector<double> next(n, kInfinity);
    for (std::size_t i = narrowest; i < n; ++i) {
      for (std::size_t w = narrowest; w <= std::min(widest, i); ++w) {
        const double width = kBinMm * static_cast<double>(w);
        const double tops = profile.tops_before[i] - profile.tops_before[i - w];
        double c = cost[i - w];
        if (missing) {
          c += kCrownInGapCostPerMm * tops;
          if (w == 0 && k + 1 < teeth) c += profile.valley[i];  // one boundary, not two
        } else {
          c += width_cost(width, usual) + kToplessCostPerMm * (width - tops);
        }
        if (c >= next[i] || !holds(i - w, i)) continue;
        next[i] = c;
        came_from[k][i] = static_cast<std::uint32_t>(i - w);
      }
      const double off_midline = profile.s_mm(i) / kMidlineSpreadMm;
      if (k + 1 == midline) next[i] += 0.25 * off_midline * off_midline;
      next[i] += k + 1 == teeth
                     ? kUncoveredCostPerMm * (profile.tops_before.back() - profile.tops_before[i]) -
                           kEndWeight * profile.left_end[i]
                     : -profile.valley[i];
    }
    cost = std::move(next);
  }
  const auto end = std::min_element(cost.begin(), cost.end());
  if (*end == kInfinity) return std::nullopt;
  ToothPartition out;
  for (std::size_t k = 0; k < teeth; ++k) out.fdi.push_back(told[k].missing ? std::uint8_t{0} : fdi[k]);
  out.cost = *end;
  auto i = static_cast<std::size_t>(end - cost.begin());
  out.boundaries_mm.push_back(profile.s_mm(i));
  for (std::size_t k = teeth; k-- > 0;) {
    i = came_from[k][i];
    out.boundaries_mm.push_back(profile.s_mm(i));
  }
  std::reverse(out.boundaries_mm.begin(), out.boundaries_mm.end());
  return out;
}

double molar_cost(int last_position) {
  return last_position == 8 ? kThirdMolarCost : (last_position == 6 ? kMissingMolarCost : 0.0);
}

}  // namespace

ToothPartition partition_teeth(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which,
                               const ToothCorrections& corrections) {
  const ArchFrame own = frame_of_jaw(arch_mesh, frame, which);
  const Profile profile = crown_profile(arch_mesh, own, which);
  const ArchRuler ruler(own);
  const auto all = fdi_order(which);
  ToothPartition best;
  best.cost = std::numeric_limits<double>::infinity();
  for (int right = 6; right <= 8; ++right)
    for (int left = 6; left <= 8; ++left) {
      const std::vector<std::uint8_t> fdi(all.begin() + 8 - right, all.begin() + 8 + left);
      if (leaves_out(fdi, corrections, which)) continue;
      const std::vector<Told> told = told_of(fdi, corrections, ruler);
      for (double scale = 0.84; scale < 1.21; scale += 0.04) {
        auto cut = best_cut(profile, fdi, told, scale);
        if (!cut) continue;
        const double off = (scale - 1.0) / kScaleSpread;
        cut->cost += 0.25 * off * off + molar_cost(right) + molar_cost(left);
        if (cut->cost < best.cost) best = *cut;
      }
    }
  return best;
}

}  // namespace gnathion
