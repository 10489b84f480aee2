#include <algorithm>

#include "design/solid_distance.h"
#include "design/verification_steps.h"
#include "occlusion/contacts.h"

namespace gnathion {
namespace {

constexpr double kStepMm = 0.2;
constexpr double kRetentive = 0.05;  // of the normal's length along a: steeper than 3°
constexpr double kReachMm = 0.2;     // a surface that goes deeper passes through this depth on its way

/// Deepest of the points inside the solid.
double deepest(const std::vector<Vector3>& points, const MeshQuery& solid) {
  double depth = 0.0;
  for (const SolidHit& hit : solid_hits(solid, points, kReachMm)) depth = std::max(depth, -hit.distance_mm);
  return depth;
}

/// Vertices, and points between them no farther apart than kStepMm.
std::vector<Vector3> points_on(const TriangleMesh& mesh) {
  std::vector<Vector3> points = mesh.vertices_mm;
  for (const SurfaceSample& sample : sample_surface(mesh, kStepMm)) points.push_back(sample.p_mm);
  return points;
}

/// Vertices of a jaw inside the splint's box; the others cannot be inside it.
std::vector<Vector3> within(const TriangleMesh& jaw, const Box& box) {
  std::vector<Vector3> points;
  for (const Vector3& v : jaw.vertices_mm)
    if ((v.array() >= box.min_mm.array()).all() && (v.array() <= box.max_mm.array()).all())
      points.push_back(v);
  return points;
}

}  // namespace

namespace {
/// Area of the cavity that looks away from the gingiva: below the height of contour, where it holds.
double retention_area_mm2(const FinishedSplint& splint) {
  const TriangleMesh cavity = splint.region({SurfacePart::kCavity});
  double area = 0.0;
  for (std::size_t t = 0; t < cavity.triangles.size(); ++t) {
    const Vector3 scaled = face_normal_scaled(cavity, t);
    if (scaled.z() < -kRetentive * scaled.norm()) area += 0.5 * scaled.norm();
  }
  return area;
}
}  // namespace

void verify_fit(const FinishedSplint& splint, const Preparation& preparation, Arch arch,
                SplintVerification& out) {
  const Box box = bounding_box(splint.mesh());
  const std::vector<Vector3> points = points_on(splint.mesh());
  const auto penetration = [&](const MeshQuery& jaw) {
    return std::max(deepest(points, jaw), deepest(within(jaw.mesh(), box), splint.query));
  };
  const bool upper = arch == Arch::kMaxilla;
  out.maxilla_penetration_mm = penetration(upper ? preparation.support : preparation.opposing);
  out.mandible_penetration_mm = penetration(upper ? preparation.opposing : preparation.support);
  out.retention_area_mm2 = retention_area_mm2(splint);

  std::vector<Vector3> cavity;
  for (std::size_t v = 0; v < splint.parts.size(); ++v)
    if (splint.parts[v] == SurfacePart::kCavity) cavity.push_back(splint.mesh().vertices_mm[v]);
  std::vector<double> gaps;
  for (const ClosestHit& hit : closest_points(preparation.support, cavity))
    gaps.push_back(std::max(0.0, hit.distance_mm));
  if (gaps.empty()) return;
  std::sort(gaps.begin(), gaps.end());
  out.seat_gap = {gaps.front(), gaps[gaps.size() / 2], gaps.back()};
}

}  // namespace gnathion
