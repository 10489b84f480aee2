// The zero level of a field as a closed triangle mesh.
#pragma once

#include <functional>
#include <vector>

#include "core/mesh.h"
#include "design/coarse_grid.h"

namespace gnathion {

/// A field to extract: `estimate` is cheap and never wrong by more than `estimate_error_mm`; `exact` is
/// called for points whose estimate is small. Both thread-safe; change by no more than about 1 per mm.
struct ExtractionField {
  std::function<double(const Vector3&)> estimate;
  std::function<double(const Vector3&)> exact;
  double estimate_error_mm = 0.25;
};

/// Marching cubes over the cells near the level; fine spacing = coarse spacing / refinement. Only the coarse
/// cells that the surface passes hold fine samples, so cost grows with area. Closed, oriented and manifold by
/// construction (cells are added until no face of the visited region is crossed); the field must be positive
/// on the boundary of the box.
TriangleMesh extracted_surface(const ExtractionField& field, const GridShape& coarse, int refinement);

/// Pieces of a surface: the largest is kept; voids inside it and islands are dropped.
struct LargestPiece {
  TriangleMesh mesh;
  std::size_t dropped_voids = 0, dropped_islands = 0;
  double largest_island_mm3 = 0.0;
};
LargestPiece largest_piece(const TriangleMesh& mesh);

}  // namespace gnathion
