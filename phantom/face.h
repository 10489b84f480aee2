// The phantom's upper face: forehead, brows, orbits, nose, cheeks and upper lip as one skin surface.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

/// Proportions of one face; drawn from a seed.
struct FaceShape {
  double width = 1.0;  ///< factors about 1
  double nose_length = 1.0;
  double nose_width = 1.0;
  double brow = 1.0;
  double cheek = 1.0;
  double asymmetry_mm = 0.0;  ///< sideways bend of the nose at its tip
};
FaceShape draw_face_shape(std::uint64_t seed);

/// Signed distance (about; negative inside the head) to the skin, in the Dental frame, over the whole head.
double skin_distance_mm(const FaceShape& shape, const Vector3& p_dental_mm);

/// Skin of the upper face in the Dental frame, an open surface of 60k–120k triangles, normals outward.
TriangleMesh make_face(const FaceShape& shape);

/// The face as its soft parts shift between two scans: displacement along a smooth random field, near 0 at
/// forehead and bridge of the nose, up to `largest_mm` at cheeks and upper lip.
TriangleMesh with_soft_tissue_shift(const TriangleMesh& face, double largest_mm, std::uint64_t seed);

}  // namespace gnathion
