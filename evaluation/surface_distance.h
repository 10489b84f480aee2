// Signed distances from the points of a scan to a surface. Made for millions of points: the points are taken
// along a space-filling curve, so that each one's answer bounds the next one's search.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

/// Where a point meets the surface.
struct SurfaceFoot {
  /// Length of the way to the foot; negative behind the surface, told by the angle-weighted pseudonormal of
  /// the closest face, edge or vertex (Bærentzen & Aanæs 2005). On a boundary the pseudonormal is that of the
  /// faces that are there: the side of the surface's smooth continuation.
  double signed_mm = 0.0;
  Vector3 point_mm = Vector3::Zero();
  Vector3 normal = Vector3::Zero();  ///< that pseudonormal, unit
  std::uint32_t triangle = 0;
  bool on_boundary = false;   ///< the closest feature is a boundary edge or vertex
  double to_boundary_mm = 0;  ///< of the foot, along the chord; at most the reach of boundary_reach_mm
};

/// Immutable; thread-safe. Results do not depend on the number of threads or the order of points.
class SurfaceDistance {
 public:
  /// Distances of feet to the boundary are known up to `boundary_reach_mm`.
  explicit SurfaceDistance(const TriangleMesh& mesh, double boundary_reach_mm = 1.0);
  ~SurfaceDistance();
  SurfaceDistance(SurfaceDistance&&) noexcept;

  /// Calls visit(i, foot) once for each point that has a foot within reach; from several threads at a time,
  /// each i once. `mesh_from_points` is applied to the points first.
  void for_each(const std::vector<Vector3>& points_mm, const Rigid3& mesh_from_points, double reach_mm,
                const std::function<void(std::size_t, const SurfaceFoot&)>& visit) const;

  bool closed() const;  ///< no boundary edge

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Distance of every vertex to the mesh's boundary, straight, at most `reach_mm` (and reach_mm where none).
std::vector<float> distances_to_boundary_mm(const TriangleMesh& mesh, double reach_mm);

}  // namespace gnathion
