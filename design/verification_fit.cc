#include <algorithm>

#include "design/parallel.h"
#include "design/solid_distance.h"
#include "design/verification_steps.h"

namespace gnathion {
namespace {

constexpr double kReachMm = 0.2;  // a surface that goes deeper passes through this depth on its way

/// Deepest of the points inside the solid.
double deepest(const std::vector<Vector3>& points, const MeshQuery& solid) {
  std::vector<double> depth(points.size(), 0.0);
  parallel_each(points.size(), [&](std::size_t i) {
    if (const auto d = solid_distance(solid, points[i], kReachMm)) depth[i] = std::max(0.0, -d->distance_mm);
  });
  return points.empty() ? 0.0 : *std::max_element(depth.begin(), depth.end());
}

std::vector<Vector3> corners_and_centres(const TriangleMesh& mesh) {
  std::vector<Vector3> points = mesh.vertices_mm;
  points.reserve(points.size() + mesh.triangles.size());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    points.push_back((mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0);
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

void verify_fit(const FinishedSplint& splint, const Preparation& preparation, SplintVerification& out) {
  const Box box = bounding_box(splint.mesh());
  const std::vector<Vector3> points = corners_and_centres(splint.mesh());
  out.maxilla_penetration_mm = std::max(deepest(points, preparation.maxilla),
                                        deepest(within(preparation.maxilla.mesh(), box), splint.query));
  out.mandible_penetration_mm = std::max(deepest(points, preparation.mandible),
                                         deepest(within(preparation.mandible.mesh(), box), splint.query));

  std::vector<Vector3> cavity;
  for (std::size_t v = 0; v < splint.parts.size(); ++v)
    if (splint.parts[v] == SurfacePart::kCavity) cavity.push_back(splint.mesh().vertices_mm[v]);
  std::vector<double> gaps(cavity.size(), 0.0);
  parallel_each(cavity.size(), [&](std::size_t i) {
    gaps[i] = std::max(0.0, preparation.maxilla.signed_distance(cavity[i])->distance_mm);
  });
  if (gaps.empty()) return;
  std::sort(gaps.begin(), gaps.end());
  out.seat_gap = {gaps.front(), gaps[gaps.size() / 2], gaps.back()};
}

}  // namespace gnathion
