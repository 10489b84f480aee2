// Room between the jaws, tooth by tooth.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "occlusion/contacts.h"

namespace gnathion {
namespace {

constexpr double kOcclusalFacing = 0.5;  // cosine to the occlusal normal: cusps, fossae, incisal edges
constexpr double kFarMm = 300.0;         // beyond any jaw
constexpr std::size_t kHeights = 600;    // of a tooth: a median needs no more

/// Vertices of one tooth, and those that look at the opposing arch.
struct ToothVertices {
  std::vector<std::uint32_t> all, occlusal;
};

std::map<std::uint8_t, ToothVertices> vertices_of_teeth(const TriangleMesh& mesh,
                                                        const std::vector<std::uint8_t>& fdi,
                                                        const Rigid3& motion, const Vector3& up) {
  const auto normals = vertex_normals(mesh);
  std::map<std::uint8_t, ToothVertices> teeth;
  for (std::uint32_t i = 0; i < fdi.size(); ++i) {
    if (fdi[i] == 0) continue;
    ToothVertices& tooth = teeth[fdi[i]];
    tooth.all.push_back(i);
    if ((motion.rotation * normals[i]).dot(up) > kOcclusalFacing) tooth.occlusal.push_back(i);
  }
  return teeth;
}

/// Negative where the point is inside the maxilla.
double signed_gap(const MeshQuery& maxilla, const ClosestHit& hit, const Vector3& p, const Vector3& up) {
  const bool inside = hit.on_boundary ? inside_surface(maxilla, p, -up) : hit.distance_mm < 0.0;
  return inside ? -std::abs(hit.distance_mm) : std::abs(hit.distance_mm);
}

/// The closest of a tooth's points that are all far from the maxilla. Each is asked no farther than the best
/// so far, those that look at the maxilla first, which makes it fast.
struct FarPoint {
  ClosestHit hit;
  Vector3 moved_mm = Vector3::Zero();
};
FarPoint closest_of_far_tooth(const ToothVertices& tooth, const MeshQuery& maxilla,
                              const TriangleMesh& mandible, const Rigid3& motion, double max_mm) {
  FarPoint best;
  double reach = max_mm;
  for (const auto* list : {&tooth.occlusal, &tooth.all})
    for (const std::uint32_t v : *list) {
      const Vector3 p = motion * mandible.vertices_mm[v];
      const auto found = maxilla.signed_distance(p, reach);
      if (!found) continue;
      best.moved_mm = p;
      best.hit = {found->closest.triangle, found->distance_mm, found->closest.point_mm, found->closest.normal,
                  found->closest.on_boundary};
      reach = std::abs(found->distance_mm) * (1.0 - 1e-9);
    }
  return best;
}

std::uint8_t label_at(const MeshQuery& maxilla, const std::vector<std::uint8_t>& fdi, const ClosestHit& hit) {
  if (fdi.empty()) return 0;
  std::uint32_t nearest = 0;
  double least = std::numeric_limits<double>::infinity();
  for (const std::uint32_t v : maxilla.mesh().triangles[hit.triangle]) {
    const double d = (maxilla.mesh().vertices_mm[v] - hit.point_mm).squaredNorm();
    if (d < least) least = d, nearest = v;
  }
  return fdi[nearest];
}

/// Heights of the maxilla's lower envelope above some of a tooth's occlusal vertices, and the share that has
/// any.
struct Heights {
  std::vector<double> mm;
  double share = 0.0;
};
Heights heights_over(const ToothVertices& tooth, const MeshQuery& maxilla, const TriangleMesh& mandible,
                     const Rigid3& motion, const Vector3& up) {
  Heights out;
  const std::size_t stride = tooth.occlusal.size() / kHeights + 1;
  std::size_t asked = 0;
  for (std::size_t i = 0; i < tooth.occlusal.size(); i += stride, ++asked) {
    const Vector3 p = motion * mandible.vertices_mm[tooth.occlusal[i]];
    if (const auto hit = maxilla.ray(p - kFarMm * up, up, 0.0, 2.0 * kFarMm))
      out.mm.push_back(hit->distance_mm - kFarMm);
  }
  if (asked > 0) out.share = static_cast<double>(out.mm.size()) / static_cast<double>(asked);
  return out;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

std::vector<ToothClearance> tooth_clearances(const MeshQuery& maxilla,
                                             const std::vector<std::uint8_t>& maxilla_fdi,
                                             const TriangleMesh& mandible,
                                             const std::vector<std::uint8_t>& mandible_fdi,
                                             const Rigid3& motion, const ArchFrame& frame, double max_mm) {
  const auto teeth = vertices_of_teeth(mandible, mandible_fdi, motion, frame.up);
  std::vector<std::uint8_t> names;
  std::vector<Vector3> moved;
  for (const auto& [fdi, tooth] : teeth) {
    names.push_back(fdi);
    for (const std::uint32_t v : tooth.all) moved.push_back(motion * mandible.vertices_mm[v]);
  }
  const std::vector<ClosestHit> hits = closest_points(maxilla, moved, std::min(max_mm, Overlap::kSearchMm));

  std::vector<ToothClearance> out(names.size());
  std::vector<std::size_t> begin(names.size() + 1, 0);
  for (std::size_t k = 0; k < names.size(); ++k) begin[k + 1] = begin[k] + teeth.at(names[k]).all.size();
  tbb::parallel_for(std::size_t{0}, names.size(), [&](std::size_t k) {
    const ToothVertices& tooth = teeth.at(names[k]);
    ToothClearance& c = out[k];
    c.fdi = names[k];
    c.min_mm = max_mm;
    const auto take = [&](const ClosestHit& hit, const Vector3& p) {
      if (hit.triangle == ClosestHit::kNoTriangle) return;
      const double gap = signed_gap(maxilla, hit, p, frame.up);
      if (gap >= c.min_mm) return;
      c.min_mm = gap;
      c.where_mm = p;
      c.opposing_fdi = label_at(maxilla, maxilla_fdi, hit);
    };
    for (std::size_t i = begin[k]; i < begin[k + 1]; ++i) take(hits[i], moved[i]);
    if (c.min_mm >= max_mm) {
      const FarPoint far = closest_of_far_tooth(tooth, maxilla, mandible, motion, max_mm);
      take(far.hit, far.moved_mm);
    }
    Heights heights = heights_over(tooth, maxilla, mandible, motion, frame.up);
    if (heights.mm.empty()) return;
    c.vertical_median_mm = median(std::move(heights.mm));
    c.opposed_fraction = heights.share;
    if (c.vertical_median_mm < 0.0) c.min_mm = std::min(c.min_mm, c.vertical_median_mm);
  });
  return out;
}

}  // namespace gnathion
