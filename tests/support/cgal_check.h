// A judge of meshes that did not make them: CGAL's polygon mesh processing. GPL, so tests only.
#pragma once

#include <cstddef>

#include "core/mesh.h"

namespace gnathion::testing {

struct CgalVerdict {
  bool is_polygon_mesh = false;  ///< manifold and consistently oriented
  bool closed = false;
  bool outward = false;
  std::size_t components = 0;
  bool self_intersects = true;
};
CgalVerdict judge_by_cgal(const TriangleMesh& mesh);

}  // namespace gnathion::testing
