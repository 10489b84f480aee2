// Meshes for the moment while the eye follows a movement: coarse, made in one pass, colours kept.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

struct CoarseMesh {
  TriangleMesh mesh;
  std::vector<std::uint32_t> source;  ///< per vertex: the vertex of the full mesh that it stands for
};

/// About `triangles` triangles, by one vertex for each occupied cell of a lattice. Faster and rougher than
/// decimated(); what belongs to a vertex of the full mesh (colours) can be looked up for the coarse one.
CoarseMesh clustered(const TriangleMesh& mesh, std::size_t triangles);

}  // namespace gnathion
