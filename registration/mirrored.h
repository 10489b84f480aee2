// Left and right exchanged: what a wrong export does to a scan, and what no rigid motion undoes.
#pragma once

#include <utility>

#include "core/mesh.h"

namespace gnathion {

/// The mirror image, closed and oriented as before. Vertices and triangles keep their order.
inline TriangleMesh mirrored(const TriangleMesh& mesh) {
  TriangleMesh out = mesh;
  for (Vector3& v : out.vertices_mm) v.x() = -v.x();
  for (Triangle& t : out.triangles) std::swap(t[1], t[2]);
  return out;
}

inline constexpr const char* kMirroredWhy =
    "the surfaces match when one of them is mirrored, and do not as they are: left and right are exchanged "
    "in "
    "one of the files";

}  // namespace gnathion
