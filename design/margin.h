// A margin curve: where the splint ends on the crowns, as drawn, in place of the cutting surface.
#pragma once

#include <vector>

#include "core/mesh_query.h"
#include "core/result.h"
#include "design/coarse_grid.h"
#include "design/edits.h"

namespace gnathion {

class OcclusalMap;

/// Refuses (kInput) curves that leave the supporting arch (3 mm) or lie less than 1 mm or more than 12 mm
/// behind its occlusal level. All in the design frame but for the curves.
Status check_margins(const std::vector<MarginCurve>& margins, const Rigid3& design_from_dental,
                     const MeshQuery& support, const OcclusalMap& level);

/// How far behind the occlusal level the deepest point of all curves lies.
double deepest_margin_mm(const std::vector<MarginCurve>& margins, const Rigid3& design_from_dental,
                         const OcclusalMap& level);

/// The cutting surface through all curves: within 6.5 mm of a curve (across z) it has the curve's
/// height, between two curves (buccal and palatal) it leads from one to the other; farther away it fades to
/// the cutting surface of the parameters.
class MarginSurface {
 public:
  MarginSurface() = default;
  MarginSurface(const std::vector<MarginCurve>& margins, const Rigid3& design_from_dental,
                const GridShape& coarse);
  bool empty() const { return nx_ == 0; }
  /// The height along z at which the splint is cut, where it would be `otherwise_mm`.
  double cut_mm(const Vector3& p_mm, double otherwise_mm) const;

 private:
  Vector3 origin_ = Vector3::Zero();
  double spacing_ = 0.25;
  int nx_ = 0, ny_ = 0;
  std::vector<float> height_, weight_;
};

}  // namespace gnathion
