// Moves the finished splint along the seating direction onto its arch.
#include <algorithm>
#include <cmath>

#include "design/swept_depth.h"
#include "design/verification_steps.h"

namespace gnathion {
namespace {

constexpr double kWayMm = 12.0;
constexpr double kStepMm = 0.3;
constexpr double kToothMm = 2.0;  // from the place to the vertex that names the tooth

/// Vertices, and points between those that are farther apart than kStepMm.
std::vector<Vector3> points_on(const TriangleMesh& mesh) {
  std::vector<Vector3> points = mesh.vertices_mm;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    double longest = 0.0;
    for (int k = 0; k < 3; ++k)
      longest = std::max(longest, (mesh.corner(t, k) - mesh.corner(t, (k + 1) % 3)).norm());
    const int n = static_cast<int>(std::ceil(longest / kStepMm));
    for (int i = 0; n > 1 && i <= n; ++i)
      for (int j = 0; i + j <= n; ++j) {
        const double u = static_cast<double>(i) / n, v = static_cast<double>(j) / n;
        points.push_back(mesh.corner(t, 0) * (1.0 - u - v) + mesh.corner(t, 1) * u + mesh.corner(t, 2) * v);
      }
  }
  return points;
}

std::vector<Vector3> beside(const std::vector<Vector3>& points, const Box& box) {
  std::vector<Vector3> out;
  for (const Vector3& p : points)
    if (p.x() > box.min_mm.x() && p.x() < box.max_mm.x() && p.y() > box.min_mm.y() && p.y() < box.max_mm.y())
      out.push_back(p);
  return out;
}

}  // namespace

std::vector<std::uint8_t> tooth_at(const Vector3& place_dental, const TriangleMesh& support,
                                   const std::vector<std::uint8_t>& fdi) {
  double nearest = kToothMm * kToothMm;
  std::uint8_t tooth = 0;
  for (std::size_t v = 0; v < fdi.size(); ++v) {
    const double d = (support.vertices_mm[v] - place_dental).squaredNorm();
    if (fdi[v] != 0 && d < nearest) {
      nearest = d;
      tooth = fdi[v];
    }
  }
  if (tooth == 0) return {};
  return {tooth};
}

void verify_insertability(const FinishedSplint& splint, const Preparation& preparation,
                          const TriangleMesh& support_dental, SplintVerification& out) {
  // Seen from its seat: the splint's points leave along -a, or the arch's points enter along +a.
  const Vector3 a = Vector3::UnitZ();
  const Box box = bounding_box(splint.mesh());
  const SweptDepth ours = deepest_on_way(points_on(splint.mesh()), -a, kWayMm, preparation.support);
  const SweptDepth theirs =
      deepest_on_way(beside(preparation.support.mesh().vertices_mm, box), a, kWayMm, splint.query);
  const bool from_ours = ours.depth_mm >= theirs.depth_mm;
  const SweptDepth& deepest = from_ours ? ours : theirs;
  const Vector3 on_splint = from_ours ? ours.start_mm : Vector3(theirs.start_mm + theirs.way_mm * a);
  const Rigid3 dental = preparation.design_from_dental.inverse();
  out.insertability = {deepest.depth_mm, deepest.way_mm, dental * on_splint,
                       tooth_at(dental * on_splint, support_dental, preparation.support_fdi)};
}

}  // namespace gnathion
