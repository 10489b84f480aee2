// The zero level of a field as a closed triangle mesh.
#pragma once

#include <functional>
#include <vector>

#include "core/mesh.h"
#include "design/coarse_grid.h"

namespace gnathion {

/// A field to extract. Both functions are thread-safe and change by no more than about 1 per mm.
struct ExtractionField {
  std::function<double(const Vector3&)> estimate;  ///< cheap; finds the level
  /// For points that lie close together (some tens); used on both ends of every edge that the level crosses.
  std::function<void(const std::vector<Vector3>&, std::vector<double>&)> exact;
  /// Where the estimate is smaller the exact value is asked at once; elsewhere only if the level comes by.
  double sure_mm = 0.12;
  /// estimate() at the nodes of one coarse cell's finer grid, k a side, z fastest; may be missing. Far from
  /// the level only the sign must be right, and the value beyond sure_mm.
  std::function<void(const Eigen::Vector3i& cell, int k, float* values)> estimate_cell = {};
};

/// `exact` from a function of single points.
std::function<void(const std::vector<Vector3>&, std::vector<double>&)> pointwise(
    std::function<double(const Vector3&)> f);

/// Marching cubes over the cells near the level; fine spacing = coarse spacing / refinement. Only the coarse
/// cells that the surface passes hold fine samples, so cost grows with area. Closed, oriented and manifold by
/// construction (cells are added until no face of the visited region is crossed); the field must be positive
/// on the boundary of the box.
TriangleMesh extracted_surface(const ExtractionField& field, const GridShape& coarse, int refinement);

/// Pieces of a surface: the largest ones are kept; voids inside them and islands are dropped.
struct LargestPiece {
  TriangleMesh mesh;
  std::size_t dropped_voids = 0, dropped_islands = 0;
  double largest_island_mm3 = 0.0;
};
LargestPiece largest_piece(const TriangleMesh& mesh, std::size_t pieces = 1);

}  // namespace gnathion
