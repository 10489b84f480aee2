#include "viewer/model/readout.h"

#include <cmath>

namespace gnathion {
namespace {

constexpr double kDegree = 0.017453292519943295;
constexpr double kMidlineMm = 3.0;  ///< half width of what counts as the midline's teeth
constexpr double kFrontMm = 7.0;    ///< depth behind the foremost point where incisal edges lie

}  // namespace

SixValues six_of(const Rigid3& t, const ArchFrame& arch) {
  const Vector3 d = t * arch.incisal_mm - arch.incisal_mm, w = log_so3(t.rotation) / kDegree;
  return {arch.left.dot(d), arch.anterior.dot(d), -arch.up.dot(d),
          arch.left.dot(w), arch.up.dot(w),       -arch.anterior.dot(w)};
}

Rigid3 motion_of(const SixValues& six, const ArchFrame& arch) {
  const Vector3 w =
      kDegree * (six.opening_deg * arch.left + six.yaw_deg * arch.up - six.roll_deg * arch.anterior);
  const Vector3 d = six.left_mm * arch.left + six.forward_mm * arch.anterior - six.down_mm * arch.up;
  const Matrix3 r = exp_so3(w);
  return {r, arch.incisal_mm + d - r * arch.incisal_mm};
}

std::optional<IncisalEdges> incisal_edges(const TriangleMesh& maxilla, const TriangleMesh& mandible,
                                          const ArchFrame& arch) {
  const auto edge = [&](const TriangleMesh& mesh, Arch which) -> std::optional<Vector3> {
    const ArchFrame own = frame_of_jaw(mesh, arch, which);
    const Vector3 gingival = arch.gingival(which);
    const double front = arch.anterior.dot(own.incisal_mm);
    std::optional<Vector3> best;
    double lowest = 1e300;
    for (const Vector3& p : mesh.vertices_mm) {
      const double side = arch.left.dot(p - arch.incisal_mm), depth = front - arch.anterior.dot(p);
      if (std::abs(side) > kMidlineMm || depth > kFrontMm || depth < -kFrontMm) continue;
      const double height = gingival.dot(p);
      if (height < lowest) lowest = height, best = p;
    }
    return best;
  };
  const auto upper = edge(maxilla, Arch::kMaxilla), lower = edge(mandible, Arch::kMandible);
  if (!upper || !lower) return std::nullopt;
  return IncisalEdges{*upper, *lower};
}

ClinicalReadout clinical_readout(const Rigid3& t, const IncisalEdges& e, const ArchFrame& arch) {
  const Vector3 lower = t * e.lower_mm;
  ClinicalReadout r;
  r.vertical_mm = -arch.up.dot(lower - e.lower_mm);
  r.overjet_mi_mm = arch.anterior.dot(e.upper_mm - e.lower_mm);
  r.overjet_mm = arch.anterior.dot(e.upper_mm - lower);
  r.overbite_mi_mm = arch.up.dot(e.lower_mm - e.upper_mm);
  r.overbite_mm = arch.up.dot(lower - e.upper_mm);
  r.midline_mm = arch.left.dot(lower - e.lower_mm);
  return r;
}

}  // namespace gnathion
