#include "design/stamp.h"

#include <algorithm>
#include <cmath>

#include "design/parallel.h"

namespace gnathion {
namespace {
constexpr double kFreeDistanceMm = 0.5;  // from the opposing arch, from where fillets may grow
constexpr double kBandMm = 9.0;          // half width of the arch that belongs to the crowns
}  // namespace

CoarseGrid stamp_body(const CoarseGrid& stamp, const Preparation& preparation, const SplintParameters& p) {
  const GridShape& shape = stamp.shape();
  const Rigid3 natural_from_tp = preparation.tp_from_mi.inverse();
  const double slope = std::sin(p.draft_deg * M_PI / 180.0);
  if (preparation.given_stamp || preparation.flat) return swept_up(stamp, slope);
  CoarseGrid tops = stamp;
  parallel_each(shape.nodes.x(), [&](int i) {
    for (int j = 0; j < shape.nodes.y(); ++j)
      for (int k = 0; k < shape.nodes.z(); ++k) {
        const Vector3 natural = natural_from_tp * shape.position(i, j, k);
        const double above = natural.z() - (preparation.level.level_mm(natural) + p.stamp_height_mm);
        const double beside = std::abs(preparation.level.off_curve_mm(natural)) - kBandMm;
        float& v = tops.at(i, j, k);
        v = std::max({v, static_cast<float>(above), static_cast<float>(beside)});
      }
  });
  return swept_up(tops, slope);
}

CoarseGrid joined_body(const CoarseGrid& shell, const CoarseGrid& stamp, const CoarseGrid& opposing,
                       const SplintParameters& p) {
  CoarseGrid both = shell;
  for (std::size_t i = 0; i < both.values().size(); ++i)
    both.values()[i] = std::min(shell.values()[i], stamp.values()[i]);
  CoarseGrid filled = closed(both, p.smoothing_mm);
  for (std::size_t i = 0; i < filled.values().size(); ++i) {
    const double near_opposing = std::max(0.0, static_cast<double>(opposing.values()[i]) - kFreeDistanceMm);
    const double allowed = stamp.values()[i] - p.imprint_depth_mm - 1.5 * near_opposing;
    const double fillet = std::max<double>(filled.values()[i], allowed);
    filled.values()[i] = static_cast<float>(std::min<double>(fillet, both.values()[i]));
  }
  return filled;
}

}  // namespace gnathion
