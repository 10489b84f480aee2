#include "design/blockout.h"

#include <algorithm>

namespace gnathion {
namespace {
constexpr double kClosingErrorMm = 0.08;  // of the closing on the coarse grid, where nothing was closed
}  // namespace

CoarseGrid coarse_cavity(const CoarseGrid& support, const CoarseGrid& support_swept,
                         const SplintParameters& p) {
  CoarseGrid cavity = support;
  for (std::size_t i = 0; i < cavity.values().size(); ++i)
    cavity.values()[i] = std::min(support.values()[i] - static_cast<float>(p.gap_mm),
                                  support_swept.values()[i] + static_cast<float>(p.engagement_mm));
  return cavity;
}

CoarseGrid without_embrasures(const CoarseGrid& cavity, const SplintParameters& p) {
  CoarseGrid out = closed(cavity, p.embrasure_mm);
  for (float& v : out.values()) v += static_cast<float>(kClosingErrorMm);
  return out;
}

}  // namespace gnathion
