// Fewer triangles where the surface is flat.
#pragma once

#include <functional>

#include "core/mesh.h"

namespace gnathion {

struct AdaptiveMeshOptions {
  /// How far from a removed vertex the surface may pass, mm, by the vertex's place; 0: it stays.
  /// Thread-safe.
  std::function<double(const Vector3&)> tolerance_mm;
  double longest_edge_mm = 1.5;
  double sharpest_corner_deg = 5.0;  ///< sharper triangles are not made
  double largest_turn_deg = 40.0;    ///< of a triangle's normal, in one step
  int rounds = 10;
};

/// Removes vertices of a closed manifold mesh by collapsing edges onto one of their ends: what remains are
/// vertices of the given mesh, and every removed one is within its tolerance of the triangles that took its
/// place (one-sided Hausdorff distance, checked for each vertex removed so far at each step). Topology is
/// kept. Deterministic on any number of threads.
TriangleMesh adaptive_mesh(const TriangleMesh& mesh, const AdaptiveMeshOptions& options);

}  // namespace gnathion
