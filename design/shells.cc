#include "design/shells.h"

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {
constexpr double kSmoothingErrorMm = 0.06;  // what smoothing and interpolation may take from the wall
}  // namespace

CoarseGrid outer_shell(const CoarseGrid& maxilla_swept, const SplintParameters& p) {
  const GridShape& shape = maxilla_swept.shape();
  const double wall = p.wall_mm + p.gap_mm + kSmoothingErrorMm;
  // M ⊕ R_a moved away from the gingiva by the extra occlusal thickness: walls stay, biting surfaces gain.
  const double extra = std::max(0.0, p.occlusal_thickness_mm - p.wall_mm) / shape.spacing_mm;
  CoarseGrid shell = maxilla_swept;
  for (int i = 0; i < shape.nodes.x(); ++i)
    for (int j = 0; j < shape.nodes.y(); ++j) {
      const float* swept = maxilla_swept.column(i, j);
      float* out = shell.column(i, j);
      const int last = shape.nodes.z() - 1;
      for (int k = 0; k <= last; ++k) {
        const int low = std::min(last, k + static_cast<int>(extra));
        const double t = extra - std::floor(extra);
        const double moved = (1.0 - t) * swept[low] + t * swept[std::min(last, low + 1)];
        out[k] = static_cast<float>(moved - wall);
      }
    }
  return shell;
}

}  // namespace gnathion
