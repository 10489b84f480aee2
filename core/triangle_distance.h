// Closest point of a triangle, with the feature (face, edge, vertex) on which it lies.
#pragma once

#include <cstdint>

#include "core/rigid.h"

namespace gnathion {

enum class TriangleFeature : std::uint8_t { kFace, kEdge0, kEdge1, kEdge2, kVertex0, kVertex1, kVertex2 };

struct TrianglePoint {
  Vector3 point_mm = Vector3::Zero();
  Vector3 barycentric = Vector3::Zero();
  TriangleFeature feature = TriangleFeature::kFace;  ///< kEdgeK runs from corner k to corner k+1
  double squared_distance = 0.0;
};

/// Closest point of abc to p. Triangles without area are treated as the segments that they are.
TrianglePoint closest_on_triangle(const Vector3& p_mm, const Vector3& a, const Vector3& b, const Vector3& c);

}  // namespace gnathion
