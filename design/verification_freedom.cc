#include <algorithm>

#include "design/verification_steps.h"

namespace gnathion {
namespace {

constexpr std::size_t kPoses = 60;     // looked at, evenly chosen
constexpr std::size_t kPoints = 8000;  // of the opposing arch, at most, in each
constexpr double kReachMm = 1.0;

/// Vertices of the opposing arch that pass through the splint's box in this pose.
std::vector<Vector3> passing(const TriangleMesh& opposing, const Rigid3& pose, const Box& box) {
  std::vector<Vector3> points;
  for (const Vector3& v : opposing.vertices_mm) {
    const Vector3 p = pose * v;
    if ((p.array() >= box.min_mm.array()).all() && (p.array() <= box.max_mm.array()).all())
      points.push_back(p);
  }
  const std::size_t stride = points.size() / kPoints + 1;
  for (std::size_t i = 0; i * stride < points.size(); ++i) points[i] = points[i * stride];
  points.resize((points.size() + stride - 1) / stride);
  return points;
}

}  // namespace

void verify_freedom(const FinishedSplint& splint, const Preparation& preparation, SplintVerification& out) {
  const std::vector<FreePose>& poses = preparation.free_poses;
  if (poses.empty()) return;
  out.freedom.emplace();
  const Box box = bounding_box(splint.mesh());
  const std::size_t stride = (poses.size() + kPoses - 1) / kPoses;
  for (std::size_t n = 0; n < poses.size(); n += stride) {
    ++out.freedom->poses;
    const auto points = passing(preparation.opposing.mesh(), poses[n].from_tp, box);
    for (const ClosestHit& hit : closest_points(splint.query, points, kReachMm))
      if (hit.triangle != ClosestHit::kNoTriangle)
        out.freedom->deepest_mm = std::max(out.freedom->deepest_mm, -hit.distance_mm);
  }
}

}  // namespace gnathion
