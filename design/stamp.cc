#include "design/stamp.h"

#include <algorithm>
#include <cmath>

#include "design/parallel.h"

namespace gnathion {
namespace {
constexpr double kFreeDistanceMm = 0.5;  // from the opposing arch, from where fillets may grow
constexpr double kBandMm = 9.0;          // half width of the arch that belongs to the crowns
constexpr double kInsetMm = 1.0;         // the draft narrows what carries the stamp by no more, however high

/// Distance from the outline that the solid has, seen along a: one layer.
CoarseGrid outline_of(const CoarseGrid& solid) {
  GridShape layer = solid.shape();
  layer.nodes.z() = 1;
  CoarseGrid least(layer, 0.0f);
  for (int i = 0; i < layer.nodes.x(); ++i)
    for (int j = 0; j < layer.nodes.y(); ++j) {
      const float* column = solid.column(i, j);
      least.at(i, j, 0) = *std::min_element(column, column + solid.shape().nodes.z());
    }
  return redistanced(least, kInsetMm + 1.0);
}

/// Swept towards the gingiva with draft; under the shell, where the draft would leave a neck or nothing, as a
/// column that goes straight up.
CoarseGrid drafted(const CoarseGrid& tops, const CoarseGrid& shell, double slope) {
  CoarseGrid out = swept_up(tops, slope);
  const CoarseGrid straight = swept_up(tops), under = swept_down(shell), outline = outline_of(tops);
  const GridShape& shape = tops.shape();
  parallel_each(shape.nodes.x(), [&](int i) {
    for (int j = 0; j < shape.nodes.y(); ++j) {
      const float inset = outline.at(i, j, 0) + static_cast<float>(kInsetMm);
      for (int k = 0; k < shape.nodes.z(); ++k)
        out.at(i, j, k) =
            std::min(out.at(i, j, k), std::max({inset, straight.at(i, j, k), under.at(i, j, k)}));
    }
  });
  return out;
}

}  // namespace

CoarseGrid stamp_body(const CoarseGrid& stamp, const CoarseGrid& shell, const Preparation& preparation,
                      const SplintParameters& p) {
  const GridShape& shape = stamp.shape();
  const Rigid3 natural_from_tp = preparation.tp_from_mi.inverse();
  const double slope = std::sin(p.draft_deg * M_PI / 180.0);
  if (preparation.given_stamp || preparation.flat) return drafted(stamp, shell, slope);
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
  return drafted(tops, shell, slope);
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
