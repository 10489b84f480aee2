// Closest-point, signed-distance and ray queries against one mesh, on Embree. Results are computed
// in double precision; Embree only finds the candidates.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "core/mesh.h"
#include "core/triangle_bundle.h"

namespace gnathion {

struct ClosestPoint {
  Vector3 point_mm = Vector3::Zero();
  std::uint32_t triangle = 0;
  double distance_mm = 0.0;
  Vector3 barycentric = Vector3::Zero();
  /// Angle-weighted pseudonormal of the closest feature (face, edge or vertex): its sign test is
  /// exact on closed meshes (Bærentzen & Aanæs 2005).
  Vector3 normal = Vector3::Zero();
  /// The closest feature lies on the mesh's boundary: beyond the rim, inside and outside mean nothing.
  bool on_boundary = false;
};

struct SignedDistance {
  double distance_mm = 0.0;  ///< negative inside (behind the surface)
  ClosestPoint closest;
};

struct RayHit {
  double distance_mm = 0.0;
  std::uint32_t triangle = 0;
  Vector3 point_mm = Vector3::Zero();
  Vector3 normal = Vector3::Zero();  ///< unit face normal
};

/// Immutable after construction; all queries are thread-safe. Keeps its own copy of the mesh.
///
/// Open meshes: a point whose closest feature is the boundary has no side. Its distance is given as
/// positive (outside) and `closest.on_boundary` is set; callers that need more ask inside().
class MeshQuery {
 public:
  explicit MeshQuery(TriangleMesh mesh);
  ~MeshQuery();
  MeshQuery(MeshQuery&&) noexcept;
  MeshQuery& operator=(MeshQuery&&) noexcept;

  const TriangleMesh& mesh() const;
  /// Closest point no farther than `max_distance_mm`; nothing if there is none.
  std::optional<ClosestPoint> closest(const Vector3& p_mm,
                                      double max_distance_mm = std::numeric_limits<double>::infinity()) const;
  std::optional<SignedDistance> signed_distance(
      const Vector3& p_mm, double max_distance_mm = std::numeric_limits<double>::infinity()) const;
  /// First hit along a unit direction between near and far, from either side.
  std::optional<RayHit> ray(const Vector3& origin_mm, const Vector3& direction, double near_mm = 0.0,
                            double far_mm = std::numeric_limits<double>::infinity()) const;
  /// Number of crossings along the ray.
  int count_crossings(const Vector3& origin_mm, const Vector3& direction) const;
  /// Generalised winding number by exact summation over the solid angles of all triangles
  /// (Jacobson 2013; Van Oosterom & Strackee 1983): about 1 inside, 0 outside, also on open meshes.
  /// O(triangles).
  double winding_number(const Vector3& p_mm) const;
  /// winding_number > 0.5: a side for every point, open mesh or closed. O(triangles).
  bool inside(const Vector3& p_mm) const { return winding_number(p_mm) > 0.5; }

 private:
  friend class LocalQuery;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The part of a mesh that can be closest to the points of one ball: many queries close together cost a
/// tenth. The same answers as MeshQuery's, to the last bit. Refers to the query; one thread at a time.
class LocalQuery {
 public:
  explicit LocalQuery(const MeshQuery& query) : query_(&query) {}
  /// Gathers for points within `radius_mm` of the centre and closest points no farther than
  /// `max_distance_mm`. Returns whether there can be any.
  bool gather(const Vector3& centre_mm, double radius_mm, double max_distance_mm);
  /// As MeshQuery's, for a point of the ball and `max_distance_mm` up to what was gathered for.
  std::optional<ClosestPoint> closest(const Vector3& p_mm, double max_distance_mm) const;
  std::optional<SignedDistance> signed_distance(const Vector3& p_mm, double max_distance_mm) const;

 private:
  const MeshQuery* query_;
  Vector3 centre_mm_ = Vector3::Zero();
  bool direct_ = false;  // too many candidates: the tree is faster
  std::vector<std::uint32_t> found_;
  std::vector<std::pair<double, std::uint32_t>> candidates_;  // (from the centre at least, triangle), sorted
  std::vector<TriangleBundle> bundles_;                       // of the candidates, in their order
  mutable std::uint32_t last_ = 0xffffffffu;                  // a neighbour's nearest triangle is near, too
};

/// closest() for many points, on all cores; entries without a closest point within reach have
/// triangle == kNoTriangle. Points that lie together, in any order, make it fast.
struct ClosestHit {
  static constexpr std::uint32_t kNoTriangle = 0xffffffffu;
  std::uint32_t triangle = kNoTriangle;
  double distance_mm = 0.0;  ///< signed as by signed_distance()
  Vector3 point_mm = Vector3::Zero();
  Vector3 normal = Vector3::Zero();  ///< as in ClosestPoint
  bool on_boundary = false;
};
std::vector<ClosestHit> closest_points(const MeshQuery& query, const std::vector<Vector3>& points_mm,
                                       double max_distance_mm = std::numeric_limits<double>::infinity());

/// Pairs of triangles of one mesh that have points in common besides the vertex or edge that they share (by
/// place). Decided exactly: touching counts, neighbours folded flat onto each other count, triangles without
/// area never do (triangle_intersection.h has the rule). At most `limit` pairs, sorted: the same ones always,
/// on any number of threads.
std::vector<std::array<std::uint32_t, 2>> self_intersections(
    const TriangleMesh& mesh, std::size_t limit = std::numeric_limits<std::size_t>::max());
/// Triangle pairs (of a, of b) that have any point in common, under the same rule.
std::vector<std::array<std::uint32_t, 2>> intersections(
    const TriangleMesh& a, const TriangleMesh& b,
    std::size_t limit = std::numeric_limits<std::size_t>::max());

}  // namespace gnathion
