#include "viewer/model/splint_maps.h"

#include <cmath>
#include <limits>
#include <map>

#include "core/mesh_query.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
constexpr double kSeatReachMm = 0.8;   ///< the cavity lies this near to the teeth, blocked-out undercut apart
constexpr double kStampReachMm = 0.4;  ///< the stamp lies this near to the opposing jaw
constexpr double kThickestMm = 8.0;

std::vector<float> thickness_of(const TriangleMesh& splint, const MeshQuery& query,
                                const std::vector<Vector3>& normals) {
  std::vector<float> out(splint.vertices_mm.size(), kNone);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Vector3 inward = -normals[i];
    if (inward.squaredNorm() < 0.5) continue;
    const auto hit = query.ray(splint.vertices_mm[i] + 0.02 * inward, inward, 0.0, kThickestMm);
    out[i] = static_cast<float>(hit ? hit->distance_mm + 0.02 : kThickestMm);  // or more
  }
  return out;
}

/// Edges between kept and dropped triangles, chained to closed curves.
std::vector<std::vector<Vector3>> border_of(const TriangleMesh& part) {
  std::vector<std::vector<Vector3>> out;
  for (const auto& loop : boundary_loops(part)) {
    if (loop.size() < 60) continue;  // specks of the classification, not the margin
    // The border runs along edges of the mesh; the eye wants the curve, not its steps.
    constexpr int kHalf = 6;
    const auto n = static_cast<int>(loop.size());
    std::vector<Vector3> curve;
    for (int i = 0; i < n; ++i) {
      Vector3 sum = Vector3::Zero();
      for (int k = -kHalf; k <= kHalf; ++k)
        sum += part.vertices_mm[loop[static_cast<std::size_t>((i + k + n) % n)]];
      curve.push_back(sum / (2 * kHalf + 1));
    }
    curve.push_back(curve.front());
    out.push_back(std::move(curve));
  }
  return out;
}

std::shared_ptr<const TriangleMesh> part_of(const TriangleMesh& mesh, const std::vector<bool>& keep) {
  return std::make_shared<const TriangleMesh>(submesh(mesh, keep));
}

}  // namespace

SplintMaps splint_maps(const TriangleMesh& splint, const TriangleMesh& support,
                       const TriangleMesh& opposing_tp, Progress& progress) {
  SplintMaps out;
  progress.begin_step("distances to the teeth", 0.5);
  const MeshQuery own(splint), jaw(support), opposing(opposing_tp);
  const std::vector<Vector3> normals = vertex_normals(splint);
  const std::vector<ClosestHit> to_jaw = closest_points(jaw, splint.vertices_mm, 3.0);
  const std::vector<ClosestHit> to_opposing = closest_points(opposing, splint.vertices_mm, 3.0);
  progress.begin_step("thickness", 0.5);
  out.thickness_mm = thickness_of(splint, own, normals);
  const std::size_t n = splint.vertices_mm.size();
  std::vector<bool> inside(n, false), biting(n, false);
  out.gap_mm.assign(n, kNone);
  out.seat_mm.assign(n, kNone);
  for (std::size_t i = 0; i < n; ++i) {
    const ClosestHit& h = to_jaw[i];
    if (h.triangle != ClosestHit::kNoTriangle) out.seat_mm[i] = static_cast<float>(h.distance_mm);
    if (h.triangle != ClosestHit::kNoTriangle)
      inside[i] = std::abs(h.distance_mm) < kSeatReachMm && h.normal.dot(normals[i]) < -0.2;
    const ClosestHit& o = to_opposing[i];
    if (o.triangle == ClosestHit::kNoTriangle) continue;
    out.gap_mm[i] = static_cast<float>(o.distance_mm);
    biting[i] = !inside[i] && std::abs(o.distance_mm) < kStampReachMm && o.normal.dot(normals[i]) < -0.3;
  }
  std::vector<bool> inner(splint.triangles.size()), outer(inner.size()), stamp(inner.size());
  for (std::size_t t = 0; t < inner.size(); ++t) {
    const Triangle& v = splint.triangles[t];
    inner[t] = inside[v[0]] + inside[v[1]] + inside[v[2]] >= 2;
    outer[t] = !inner[t];
    stamp[t] = biting[v[0]] && biting[v[1]] && biting[v[2]];
  }
  out.inner = part_of(splint, inner);
  out.outer = part_of(splint, outer);
  out.stamp = part_of(splint, stamp);
  out.margin_mm = border_of(*out.inner);
  return out;
}

std::vector<float> undercut_deg(const TriangleMesh& support, const Vector3& insertion) {
  const std::vector<Vector3> normals = vertex_normals(support);
  std::vector<float> out(normals.size());
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = static_cast<float>(std::asin(std::clamp(normals[i].dot(insertion), -1.0, 1.0)) * 57.29577951);
  return out;
}

std::vector<float> difference_mm(const TriangleMesh& a, const TriangleMesh& b, double reach_mm) {
  const MeshQuery query(b);
  const std::vector<ClosestHit> hits = closest_points(query, a.vertices_mm, reach_mm);
  std::vector<float> out(hits.size(), kNone);
  for (std::size_t i = 0; i < hits.size(); ++i)
    if (hits[i].triangle != ClosestHit::kNoTriangle) out[i] = static_cast<float>(hits[i].distance_mm);
  return out;
}

std::vector<ToothLabel> tooth_labels(const TriangleMesh& mesh, const ArchFrame& frame, Arch which) {
  const std::vector<std::uint8_t> fdi = assign_teeth(mesh, frame, which);
  struct Sum {
    Vector3 p = Vector3::Zero();
    double n = 0, top = -1e300;
  };
  std::map<int, Sum> sums;
  const Vector3 occlusal = -frame.gingival(which);
  for (std::size_t i = 0; i < fdi.size(); ++i) {
    if (!fdi[i]) continue;
    Sum& s = sums[fdi[i]];
    s.p += mesh.vertices_mm[i];
    s.n += 1;
    s.top = std::max(s.top, occlusal.dot(mesh.vertices_mm[i]));
  }
  std::vector<ToothLabel> out;
  for (const auto& [number, s] : sums) {
    const Vector3 centre = s.p / s.n;
    out.push_back({number, centre + (s.top + 0.6 - occlusal.dot(centre)) * occlusal});
  }
  return out;
}

}  // namespace gnathion
