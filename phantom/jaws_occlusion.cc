// Bringing two laid-out arches into maximal intercuspation.
#include <algorithm>
#include <array>
#include <cmath>

#include <tbb/parallel_for.h>

#include "phantom/jaws_arch.h"

namespace gnathion {
namespace {

constexpr double kCuspReachMm = 1.8;        ///< a cusp's contacts lie this near to its tip, in plan view
constexpr double kMostWaxMm = 1.4;          ///< no cusp is changed by more
constexpr double kMostLevelMm = 0.7;        ///< no back tooth erupts or intrudes by more
constexpr double kMostEruptionMm = 1.2;     ///< no front tooth erupts or intrudes by more
constexpr double kFrontClearanceMm = 0.06;  ///< incisors just miss each other in MI; canines touch

struct Sample {
  Vector3 point_mm;
  double gap_mm;
};

/// The occlusal side of a lower tooth with its distance from the upper crowns.
std::vector<Sample> gaps_of(const PlacedTooth& tooth, const DentalArch& upper, double step) {
  const ToothForm& f = tooth.crown.form();
  std::vector<Sample> samples;
  for (double u = -f.distal_mm[5]; u <= f.mesial_mm[5]; u += step) {
    for (double v = f.lingual_mm[4]; v <= f.buccal_mm[4]; v += step) {
      const Vector3 p = tooth.crown.surface_from_above_mm(u, v);
      if (std::isnan(p.z())) continue;
      const Vector3 world = tooth.to_jaw(p);
      const double gap = upper.crowns_mm(world);
      if (gap < 1.9) samples.push_back({world, gap});
    }
  }
  return samples;
}

using Gaps = std::array<std::vector<Sample>, 14>;

Gaps measure(const DentalArches& arches, double step) {
  Gaps gaps;
  tbb::parallel_for(0, 14, [&](int i) { gaps[i] = gaps_of(arches.lower.teeth[i], arches.upper, step); });
  return gaps;
}

double smallest(const std::vector<Sample>& samples) {
  double gap = 2.0;
  for (const Sample& s : samples) gap = std::min(gap, s.gap_mm);
  return gap;
}

/// The gap at one cusp: the smallest near its tip.
double gap_at(const Vector3& tip, const Gaps& gaps) {
  double gap = 2.0;
  for (const auto& samples : gaps) {
    for (const Sample& s : samples) {
      if ((s.point_mm - tip).head<2>().squaredNorm() < kCuspReachMm * kCuspReachMm)
        gap = std::min(gap, s.gap_mm);
    }
  }
  return gap;
}

/// A functional cusp and how much wax has been put on it.
struct Cusp {
  PlacedTooth* tooth;
  int point;
  double added_mm = 0.0;
  Vector3 tip() const {
    const ReliefPoint& p = tooth->crown.form().points[point];
    return tooth->to_jaw({p.u_mm, p.v_mm, p.w_mm});
  }
};

std::vector<Cusp> functional_cusps(DentalArches& arches) {
  std::vector<Cusp> cusps;
  for (DentalArch* arch : {&arches.upper, &arches.lower}) {
    for (PlacedTooth& t : arch->teeth) {
      for (const int point : t.crown.form().functional_cusps) cusps.push_back({&t, point, 0.0});
    }
  }
  return cusps;
}

/// The whole upper arch is lowered or raised until half of the functional cusps have met the other jaw.
void close(DentalArches& arches) {
  const std::vector<Cusp> cusps = functional_cusps(arches);
  for (int round = 0; round < 4; ++round) {
    const Gaps gaps = measure(arches, 0.6);
    std::vector<double> at_cusps;
    for (const Cusp& c : cusps) at_cusps.push_back(gap_at(c.tip(), gaps));
    std::nth_element(at_cusps.begin(), at_cusps.begin() + at_cusps.size() / 2, at_cusps.end());
    const double median = at_cusps[at_cusps.size() / 2];
    for (PlacedTooth& t : arches.upper.teeth) t.origin_mm.z() -= median;
  }
}

/// Each lower back tooth erupts or intrudes as a whole to where its functional cusps meet the upper jaw on
/// the average, so that little is left for waxing.
void level(DentalArches& arches) {
  std::array<double, 14> erupted{};
  for (int round = 0; round < 3; ++round) {
    const Gaps gaps = measure(arches, 0.5);
    for (int i = 0; i < 14; ++i) {
      PlacedTooth& t = arches.lower.teeth[i];
      const std::vector<int>& points = t.crown.form().functional_cusps;
      if (points.empty()) continue;
      double mean = 0.0;
      for (const int point : points)
        mean += gap_at(Cusp{&t, point}.tip(), gaps) / static_cast<double>(points.size());
      const double change = std::clamp(0.8 * mean, -kMostLevelMm - erupted[i], kMostLevelMm - erupted[i]);
      erupted[i] += change;
      t.origin_mm.z() += change;
    }
  }
}

}  // namespace

void settle_into_occlusion(DentalArches& arches) {
  close(arches);
  level(arches);
  std::vector<Cusp> cusps = functional_cusps(arches);
  std::array<double, 14> erupted{};
  for (int round = 0; round < 12; ++round) {
    const Gaps gaps = measure(arches, round < 8 ? 0.5 : 0.3);
    for (Cusp& c : cusps) {
      const double change =
          std::clamp(0.6 * gap_at(c.tip(), gaps), -kMostWaxMm - c.added_mm, kMostWaxMm - c.added_mm);
      c.added_mm += change;
      c.tooth->crown.form().points[c.point].w_mm += change;
    }
    for (int i = 0; i < 14; ++i) {
      PlacedTooth& t = arches.lower.teeth[i];
      if (t.posterior()) continue;
      const double gap = smallest(gaps[i]) - (t.number() == 3 ? 0.0 : kFrontClearanceMm);
      const double change =
          std::clamp(0.8 * gap, -kMostEruptionMm - erupted[i], kMostEruptionMm - erupted[i]);
      erupted[i] += change;
      t.origin_mm.z() += change;
    }
  }
}

}  // namespace gnathion
