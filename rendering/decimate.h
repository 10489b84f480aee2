// Meshes made smaller for looking at; never for measuring.
#pragma once

#include <cstddef>

#include "core/mesh.h"

namespace gnathion {

/// About `triangles` triangles (never more than asked, but for tiny meshes), shape kept by quadric error. A
/// smaller mesh comes back as it is. Colours are dropped.
TriangleMesh decimated(const TriangleMesh& mesh, std::size_t triangles);

}  // namespace gnathion
