// Surfaces of distance fields as triangle meshes: dual marching cubes (Nielson 2004) on a sparse lattice.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

/// About a signed distance in mm, negative inside; NaN where nothing is known. Called from many threads.
using Field = std::function<double(const Vector3&)>;

/// A cubic lattice, turned in space; cells are numbered by their lower corner.
struct Lattice {
  Rigid3 space_from_lattice;
  double edge_mm = 1.0;
  Vector3 point(int i, int j, int k) const { return space_from_lattice * (edge_mm * Vector3(i, j, k)); }
};

/// A cell's (or corner's) three indices in one number that sorts; each within ±2^20.
using CellKey = std::uint64_t;

/// Cells that the field's zero may cross; `lipschitz` bounds |gradient|.
std::vector<CellKey> cells_near_zero(const Field& field, const Box& box, const Lattice& lattice,
                                     double lipschitz);
/// Cells that the mesh's triangles may pass through.
std::vector<CellKey> cells_near_mesh(const TriangleMesh& mesh, const Lattice& lattice);

/// The zero set inside the given cells (sorted, unique): one vertex a cell, two triangles for each lattice
/// edge that changes sign with all four cells around it known. Normals point to positive values.
TriangleMesh surface_net(const std::vector<CellKey>& cells, const Lattice& lattice, const Field& field);

/// Moves the vertices to their targets, but for those whose triangles would turn over or collapse.
void move_without_folds(TriangleMesh& mesh, const std::vector<Vector3>& targets);

/// Vertices brought onto the zero of the field along its gradient, by at most `limit_mm` each.
void project_to_zero(TriangleMesh& mesh, const Field& field, double limit_mm);

/// The whole thing for a modelled solid: mesh of the zero of `field` inside `box`, vertices on it.
TriangleMesh mesh_of_field(const Field& field, const Box& box, double edge_mm, double lipschitz = 1.1);

/// The part of the mesh where `keep` is positive; triangles that cross its zero are cut there.
TriangleMesh clipped(const TriangleMesh& mesh, const std::function<double(const Vector3&)>& keep);

/// The mesh without its components of fewer than `smallest` triangles.
TriangleMesh without_islands(const TriangleMesh& mesh, std::size_t smallest);

}  // namespace gnathion
