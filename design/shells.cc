#include "design/shells.h"

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {
constexpr double kSmoothingErrorMm =
    0.08;                       // what sweeping, smoothing and interpolation may take from the wall
constexpr double kLipMm = 0.5;  // how far the rim may stand beyond the wall across a
constexpr double kOutlineBandMm = 8.0;
}  // namespace

CoarseGrid distance_from_rim_outline(const CoarseGrid& support_swept, const Preparation& preparation,
                                     const SplintParameters& p) {
  GridShape flat = support_swept.shape();
  flat.nodes.z() = 2;
  CoarseGrid at_rim(flat, 0.0f);
  for (int i = 0; i < flat.nodes.x(); ++i)
    for (int j = 0; j < flat.nodes.y(); ++j) {
      Vector3 q = flat.position(i, j, 0);
      q.z() = preparation.cut_mm(q, p.depth_mm);
      at_rim.at(i, j, 0) = at_rim.at(i, j, 1) = static_cast<float>(support_swept.linear(q));
    }
  return redistanced(at_rim, kOutlineBandMm);
}

CoarseGrid outer_shell(const CoarseGrid& support_swept, const CoarseGrid& outline_distance,
                       const SplintParameters& p) {
  const GridShape& shape = support_swept.shape();
  const double wall = p.wall_mm + p.gap_mm + kSmoothingErrorMm;
  // M ⊕ R_a moved away from the gingiva by the extra occlusal thickness: walls stay, biting surfaces gain.
  const double extra = std::max(0.0, p.occlusal_thickness_mm - p.wall_mm) / shape.spacing_mm;
  CoarseGrid shell = support_swept;
  for (int i = 0; i < shape.nodes.x(); ++i)
    for (int j = 0; j < shape.nodes.y(); ++j) {
      const float* swept = support_swept.column(i, j);
      float* out = shell.column(i, j);
      const int last = shape.nodes.z() - 1;
      for (int k = 0; k <= last; ++k) {
        const int low = std::min(last, k + static_cast<int>(extra));
        const double t = extra - std::floor(extra);
        const double moved = (1.0 - t) * swept[low] + t * swept[std::min(last, low + 1)];
        const double lip = outline_distance.at(i, j, 0) - (wall + kLipMm);
        out[k] = static_cast<float>(std::max(moved - wall, lip));
      }
    }
  return shell;
}

}  // namespace gnathion
