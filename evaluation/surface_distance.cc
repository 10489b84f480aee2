#include "evaluation/surface_distance.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/mesh_edges.h"
#include "core/triangle_distance.h"
#include "evaluation/box_tree.h"
#include "evaluation/space_curve.h"
#include "registration/point_grid.h"

namespace gnathion {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr std::size_t kPointsPerPiece = 4096, kGroup = 16;

/// Points along the boundary edges, no farther apart than step_mm.
std::vector<Vector3> boundary_points(const TriangleMesh& mesh, const MeshEdges& edges, double step_mm) {
  std::vector<Vector3> points;
  edges.for_each([&](std::uint32_t low, const EdgeUse* uses, std::size_t n) {
    if (n != 1) return;
    const Vector3 a = mesh.vertices_mm[low], b = mesh.vertices_mm[uses->high];
    const int pieces = std::max(1, static_cast<int>(std::min(1e4, std::ceil((b - a).norm() / step_mm))));
    for (int k = 0; k <= pieces; ++k) points.push_back(a + (b - a) * (static_cast<double>(k) / pieces));
  });
  return points;
}

TriangleMesh welded_in_place(const TriangleMesh& mesh) {
  const std::vector<std::uint32_t> same = first_equal_vertices(mesh.vertices_mm);
  TriangleMesh welded;
  welded.vertices_mm = mesh.vertices_mm;
  welded.triangles = mesh.triangles;
  for (Triangle& t : welded.triangles) t = {same[t[0]], same[t[1]], same[t[2]]};
  return welded;
}

std::vector<float> boundary_distances(const TriangleMesh& mesh, const MeshEdges& edges, double reach_mm) {
  std::vector<float> distances(mesh.vertices_mm.size(), static_cast<float>(reach_mm));
  const std::vector<Vector3> rim = boundary_points(mesh, edges, 0.1 * reach_mm);
  if (rim.empty()) return distances;
  const PointGrid grid(rim, reach_mm);
  tbb::parallel_for(std::size_t{0}, distances.size(), [&](std::size_t i) {
    const long k = grid.nearest(mesh.vertices_mm[i], reach_mm);
    if (k >= 0)
      distances[i] = static_cast<float>((rim[static_cast<std::size_t>(k)] - mesh.vertices_mm[i]).norm());
  });
  return distances;
}

}  // namespace

struct SurfaceDistance::Impl {
  TriangleMesh mesh;  ///< vertices at one place count as one
  BoxTree tree;
  std::vector<std::uint32_t> across;  ///< per side the triangle across it; kNone on boundaries
  std::vector<Vector3> normal_at;     ///< per vertex
  std::vector<bool> boundary_at;      ///< per vertex
  std::vector<float> to_boundary;     ///< per vertex
  bool has_boundary = false;

  Impl(const TriangleMesh& m, double boundary_reach_mm)
      : mesh(welded_in_place(m)), tree(mesh), normal_at(vertex_normals(mesh)) {
    across.assign(3 * mesh.triangles.size(), kNone);
    boundary_at.assign(mesh.vertices_mm.size(), false);
    const MeshEdges edges(mesh);
    edges.for_each([&](std::uint32_t low, const EdgeUse* uses, std::size_t n) {
      if (n == 1) boundary_at[low] = boundary_at[uses->high] = has_boundary = true;
      // Where three or more triangles meet, each takes the next one as its neighbour.
      for (std::size_t i = 0; n >= 2 && i < n; ++i)
        across[3 * uses[i].triangle + uses[i].side] = uses[(i + 1) % n].triangle;
    });
    to_boundary = boundary_distances(mesh, edges, boundary_reach_mm);
  }

  Vector3 unit_normal(std::uint32_t triangle) const {
    const Vector3 n = face_normal_scaled(mesh, triangle);
    const double length = n.norm();
    return length > 0.0 ? Vector3(n / length) : Vector3(Vector3::Zero());
  }
  SurfaceFoot finished(const Vector3& p, std::uint32_t triangle, const TrianglePoint& found) const;
};

SurfaceFoot SurfaceDistance::Impl::finished(const Vector3& p, std::uint32_t triangle,
                                            const TrianglePoint& found) const {
  SurfaceFoot foot;
  foot.point_mm = found.point_mm;
  foot.triangle = triangle;
  Vector3 normal = unit_normal(triangle);
  const auto feature = static_cast<std::uint32_t>(found.feature);
  if (found.feature >= TriangleFeature::kVertex0) {
    const std::uint32_t v =
        mesh.triangles[triangle][feature - static_cast<std::uint32_t>(TriangleFeature::kVertex0)];
    normal = normal_at[v];
    foot.on_boundary = boundary_at[v];
  } else if (found.feature != TriangleFeature::kFace) {
    const std::uint32_t side = 3 * triangle + feature - static_cast<std::uint32_t>(TriangleFeature::kEdge0);
    foot.on_boundary = across[side] == kNone;
    if (!foot.on_boundary) normal += unit_normal(across[side]);
  }
  const double length = normal.norm();
  if (length > 0.0) foot.normal = normal / length;
  const double distance = std::sqrt(found.squared_distance);
  foot.signed_mm = (p - found.point_mm).dot(foot.normal) < 0.0 ? -distance : distance;
  const Triangle& t = mesh.triangles[triangle];
  for (int k = 0; k < 3; ++k) foot.to_boundary_mm += found.barycentric[k] * to_boundary[t[k]];
  if (foot.on_boundary) foot.to_boundary_mm = 0.0;
  return foot;
}

SurfaceDistance::SurfaceDistance(const TriangleMesh& mesh, double boundary_reach_mm)
    : impl_(std::make_unique<Impl>(mesh, boundary_reach_mm)) {}
SurfaceDistance::~SurfaceDistance() = default;
SurfaceDistance::SurfaceDistance(SurfaceDistance&&) noexcept = default;

bool SurfaceDistance::closed() const {
  return !impl_->has_boundary;
}

void SurfaceDistance::for_each(const std::vector<Vector3>& points_mm, const Rigid3& mesh_from_points,
                               double reach_mm,
                               const std::function<void(std::size_t, const SurfaceFoot&)>& visit) const {
  const Impl& self = *impl_;
  if (self.mesh.triangles.empty()) return;
  const std::vector<std::uint32_t> order = hilbert_order(points_mm);
  const std::size_t pieces = (order.size() + kPointsPerPiece - 1) / kPointsPerPiece;
  tbb::parallel_for(std::size_t{0}, pieces, [&](std::size_t piece) {
    const std::size_t end = std::min(order.size(), (piece + 1) * kPointsPerPiece);
    BoxTree::Search search, of_centre;
    BoxTree::Entries entries;
    std::array<Vector3, kGroup> p;
    for (std::size_t begin = piece * kPointsPerPiece; begin < end; begin += kGroup) {
      const std::size_t count = std::min(kGroup, end - begin);
      // All of a group is near to what is near to its middle: the tree is entered once.
      Box box;
      for (std::size_t i = 0; i < count; ++i) {
        p[i] = mesh_from_points * points_mm[order[begin + i]];
        if (p[i].allFinite()) box.extend(p[i]);
      }
      if (!box.min_mm.allFinite() || box.min_mm.x() > box.max_mm.x()) continue;
      const Vector3 centre = box.centre_mm();
      const double radius = 0.5 * box.size_mm().norm();
      if (!self.tree.closest(self.mesh, centre, reach_mm + radius, of_centre)) continue;
      const double to_centre = std::sqrt(of_centre.best.squared_distance);
      self.tree.gather(centre, std::min(to_centre + 2.0 * radius, reach_mm + radius), entries);
      search.triangle = of_centre.triangle;
      for (std::size_t i = 0; i < count; ++i) {
        if (!p[i].allFinite()) continue;
        if (self.tree.closest(self.mesh, p[i], reach_mm, search, &entries))
          visit(order[begin + i], self.finished(p[i], search.triangle, search.best));
      }
    }
  });
}

std::vector<float> distances_to_boundary_mm(const TriangleMesh& mesh, double reach_mm) {
  const TriangleMesh welded = welded_in_place(mesh);
  return boundary_distances(welded, MeshEdges(welded), reach_mm);
}

}  // namespace gnathion
