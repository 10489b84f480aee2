// What is read off a finished splint to look at: inner and outer surface, thickness, margin, undercut.
#pragma once

#include <memory>
#include <vector>

#include "core/mesh.h"
#include "core/progress.h"
#include "occlusion/arch.h"

namespace gnathion {

struct SplintMaps {
  std::shared_ptr<const TriangleMesh> inner, outer, stamp;  ///< parts of the splint; may be null
  std::vector<std::vector<Vector3>> margin_mm;              ///< closed curves between inner and outer
  std::vector<float> thickness_mm;  ///< per vertex of the splint, along the normal; NaN: none
  std::vector<float> gap_mm;        ///< per vertex: to the opposing jaw in TP; NaN beyond 3 mm
  std::vector<float> seat_mm;       ///< per vertex: to the teeth that wear it; NaN beyond 3 mm
};
/// `support`: the arch that wears the splint. All in Dental, in TP. For a background job.
SplintMaps splint_maps(const TriangleMesh& splint, const TriangleMesh& support,
                       const TriangleMesh& opposing_tp, Progress& progress);

/// Per vertex of the arch: the angle by which its surface faces away from where the splint comes, degrees;
/// positive is undercut.
std::vector<float> undercut_deg(const TriangleMesh& support, const Vector3& insertion);

/// Signed distance from a's vertices to b, positive outside of b; NaN beyond `reach_mm`.
std::vector<float> difference_mm(const TriangleMesh& a, const TriangleMesh& b, double reach_mm);

/// Where to write a tooth's number: over its crown.
struct ToothLabel {
  int fdi = 0;
  Vector3 at_mm = Vector3::Zero();
};
std::vector<ToothLabel> tooth_labels(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which);

}  // namespace gnathion
