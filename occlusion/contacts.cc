#include "occlusion/contacts.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double longest_edge(const TriangleMesh& mesh, std::size_t t) {
  const Vector3 a = mesh.corner(t, 0), b = mesh.corner(t, 1), c = mesh.corner(t, 2);
  return std::sqrt(std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()}));
}

/// Triangles that can hold a point no farther than limit_mm from the other surface, told from the gaps
/// at their corners (known up to reach_mm): no point of a triangle is farther from a corner than its longest
/// edge. Large triangles far away are left out by the other surface's box.
std::vector<bool> near_triangles(const TriangleMesh& mesh, const std::vector<double>& gap_at_vertex,
                                 double limit_mm, double reach_mm, const Rigid3& motion, const Box& other) {
  std::vector<bool> near(mesh.triangles.size(), false);
  const Vector3 margin = Vector3::Constant(std::max(0.0, limit_mm));
  for (std::size_t t = 0; t < near.size(); ++t) {
    double gap = reach_mm;
    for (const auto v : mesh.triangles[t]) gap = std::min(gap, gap_at_vertex[v]);
    if (gap > limit_mm + longest_edge(mesh, t)) continue;
    Box box;
    for (int k = 0; k < 3; ++k) box.extend(motion * mesh.corner(t, k));
    near[t] = ((box.min_mm - margin).array() <= other.max_mm.array()).all() &&
              ((box.max_mm + margin).array() >= other.min_mm.array()).all();
  }
  return near;
}

std::vector<Vector3> points_of(const std::vector<SurfaceSample>& samples) {
  std::vector<Vector3> out;
  out.reserve(samples.size());
  for (const auto& s : samples) out.push_back(s.p_mm);
  return out;
}

/// Samples of `mesh` that may be no farther than limit_mm from `other`, or nearest to it, with their signed
/// gaps.
struct NearSamples {
  std::vector<double> vertex_gap_mm;
  std::vector<SurfaceSample> samples;
  std::vector<double> gap_mm;
};
NearSamples near_samples(const TriangleMesh& mesh, const Rigid3& motion, const MeshQuery& other,
                         const Vector3& outward, double limit_mm, double reach_mm, double step_mm) {
  NearSamples out;
  out.vertex_gap_mm = signed_gaps_mm(mesh.vertices_mm, motion, other, outward, reach_mm);
  const auto& at_vertex = out.vertex_gap_mm;
  if (at_vertex.empty()) return out;
  const double nearest = std::min(reach_mm, *std::min_element(at_vertex.begin(), at_vertex.end()));
  const auto near = near_triangles(mesh, at_vertex, std::max(limit_mm, nearest), reach_mm, motion,
                                   bounding_box(other.mesh()));
  out.samples = sample_surface(mesh, step_mm, near);
  out.gap_mm = signed_gaps_mm(points_of(out.samples), motion, other, outward, reach_mm);
  return out;
}

/// Which triangles hang together: sets that share vertices.
class TrianglePatches {
 public:
  explicit TrianglePatches(std::size_t vertices) : parent_(vertices) {
    std::iota(parent_.begin(), parent_.end(), 0u);
  }
  void join(const Triangle& t) {
    for (int k = 1; k < 3; ++k) {
      const auto a = find(t[0]), b = find(t[static_cast<std::size_t>(k)]);
      parent_[std::max(a, b)] = std::min(a, b);
    }
  }
  std::uint32_t find(std::uint32_t v) {
    while (parent_[v] != v) v = parent_[v] = parent_[parent_[v]];
    return v;
  }

 private:
  std::vector<std::uint32_t> parent_;
};

}  // namespace

bool inside_surface(const MeshQuery& surface, const Vector3& p_mm, const Vector3& outward) {
  const auto found = surface.signed_distance(p_mm);
  if (!found) return false;
  if (!found->closest.on_boundary) return found->distance_mm < 0.0;
  const Vector3 side = outward.unitOrthogonal(), other_side = outward.cross(side);
  int inside = surface.count_crossings(p_mm, outward) % 2;
  for (int k = 0; k < 4; ++k) {
    const Vector3 lateral = (k % 2 ? -1.0 : 1.0) * (k < 2 ? side : other_side);
    inside += surface.count_crossings(p_mm, (outward + lateral).normalized()) % 2;
  }
  return inside >= 3;
}

std::vector<SurfaceSample> sample_surface(const TriangleMesh& mesh, double step_mm,
                                          const std::vector<bool>& triangle_wanted) {
  std::vector<SurfaceSample> out;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!triangle_wanted.empty() && !triangle_wanted[t]) continue;
    const Vector3 a = mesh.corner(t, 0), b = mesh.corner(t, 1), c = mesh.corner(t, 2);
    const int n = std::clamp(static_cast<int>(std::ceil(longest_edge(mesh, t) / step_mm)), 1, 64);
    const double area = 0.5 * (b - a).cross(c - a).norm() / (n * n);
    if (area <= 0.0) continue;
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < 2 * (n - i) - 1; ++j) {
        // Piece j of row i: upright for even j, upside down for odd; its centroid.
        const double third = j % 2 == 0 ? 1.0 / 3.0 : 2.0 / 3.0;
        const double u = (i + third) / n, v = (j / 2 + third) / n, w = 1.0 - u - v;
        const std::size_t corner = w >= u && w >= v ? 0 : (u >= v ? 1 : 2);
        out.push_back(
            {w * a + u * b + v * c, area, static_cast<std::uint32_t>(t), mesh.triangles[t][corner]});
      }
  }
  return out;
}

std::vector<double> signed_gaps_mm(const std::vector<Vector3>& points_mm, const Rigid3& motion,
                                   const MeshQuery& surface, const Vector3& outward, double max_mm) {
  std::vector<Vector3> moved(points_mm.size());
  for (std::size_t i = 0; i < moved.size(); ++i) moved[i] = motion * points_mm[i];
  const std::vector<ClosestHit> hits = closest_points(surface, moved, max_mm);
  std::vector<double> gap(points_mm.size(), kInfinity);
  tbb::parallel_for(std::size_t{0}, gap.size(), [&](std::size_t i) {
    if (hits[i].triangle == ClosestHit::kNoTriangle) return;
    gap[i] = hits[i].distance_mm;
    if (hits[i].on_boundary && inside_surface(surface, moved[i], outward)) gap[i] = -gap[i];
  });
  return gap;
}

Overlap find_overlap(const MeshQuery& maxilla, const MeshQuery& mandible, const Rigid3& motion,
                     const Vector3& up, double step_mm, double search_mm) {
  const Rigid3 back = motion.inverse();
  const auto lower = near_samples(mandible.mesh(), motion, maxilla, -up, 0.0, search_mm, step_mm);
  const auto upper =
      near_samples(maxilla.mesh(), back, mandible, back.rotation * up, 0.0, search_mm, step_mm);
  Overlap out;
  double nearest = search_mm;
  // Returns the depth of one surface inside the other; vertices count beside the samples between them.
  auto look = [&](const NearSamples& side, const TriangleMesh& mesh, const Rigid3& to_dental) {
    double depth = 0.0;
    auto at = [&](double gap, const Vector3& p) {
      depth = std::max(depth, -gap);
      if (-gap > out.depth_mm) {
        out.depth_mm = -gap;
        out.where_mm = to_dental * p;
      }
      if (gap < nearest) {
        nearest = gap;
        out.closest_mm = to_dental * p;
      }
    };
    for (std::size_t i = 0; i < side.samples.size(); ++i) at(side.gap_mm[i], side.samples[i].p_mm);
    for (std::size_t i = 0; i < side.vertex_gap_mm.size(); ++i)
      at(side.vertex_gap_mm[i], mesh.vertices_mm[i]);
    return depth;
  };
  out.mandible_depth_mm = look(lower, mandible.mesh(), motion);
  out.maxilla_depth_mm = look(upper, maxilla.mesh(), Rigid3::identity());
  for (std::size_t i = 0; i < lower.samples.size(); ++i) {
    if (lower.gap_mm[i] >= 0.0) continue;
    out.area_mm2 += lower.samples[i].area_mm2;
    out.volume_mm3 -= lower.gap_mm[i] * lower.samples[i].area_mm2;
  }
  out.min_distance_mm = std::max(0.0, nearest);
  return out;
}

Contacts find_contacts(const TriangleMesh& surface, const std::vector<std::uint8_t>& fdi_of_vertex,
                       const Rigid3& motion, const MeshQuery& opposing, const Vector3& outward,
                       const ArchFrame& frame, double limit_mm, double step_mm) {
  const auto near = near_samples(surface, motion, opposing, outward, limit_mm, limit_mm + 2.0, step_mm);
  Contacts out;
  TrianglePatches patches(surface.vertices_mm.size());
  for (std::size_t i = 0; i < near.samples.size(); ++i) {
    if (near.gap_mm[i] > limit_mm) continue;
    out.samples.push_back(near.samples[i]);
    patches.join(surface.triangles[near.samples[i].triangle]);
  }
  auto fdi_of = [&](const SurfaceSample& s) {
    return fdi_of_vertex.empty() ? std::uint8_t{0} : fdi_of_vertex[s.vertex];
  };
  std::map<std::uint8_t, double> per_tooth;
  std::map<std::uint32_t, std::pair<ContactPatch, std::map<std::uint8_t, double>>> by_root;
  for (const auto& s : out.samples) {
    const Vector3 p = motion * s.p_mm;
    out.area_mm2 += s.area_mm2;
    (frame.to_arch(p).x() >= 0.0 ? out.left_area_mm2 : out.right_area_mm2) += s.area_mm2;
    const std::uint8_t fdi = fdi_of(s);
    if (fdi_is_front(fdi)) out.front_area_mm2 += s.area_mm2;
    if (fdi != 0) per_tooth[fdi] += s.area_mm2;
    auto& [patch, teeth] = by_root[patches.find(surface.triangles[s.triangle][0])];
    patch.centre_mm += s.area_mm2 * p;
    patch.area_mm2 += s.area_mm2;
    teeth[fdi] += s.area_mm2;
  }
  for (const auto& [fdi, area] : per_tooth) out.per_tooth.push_back({fdi, area});
  for (auto& [root, entry] : by_root) {
    auto& [patch, teeth] = entry;
    patch.centre_mm /= patch.area_mm2;
    patch.fdi = std::max_element(teeth.begin(), teeth.end(), [](const auto& a, const auto& b) {
                  return a.second < b.second;
                })->first;
    out.patches.push_back(patch);
  }
  std::stable_sort(out.patches.begin(), out.patches.end(),
                   [](const ContactPatch& a, const ContactPatch& b) { return a.area_mm2 > b.area_mm2; });
  return out;
}

}  // namespace gnathion
