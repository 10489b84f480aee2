// The signed distances of a whole scan to a model, and which of its points should count.
#pragma once

#include <vector>

#include "evaluation/evaluation.h"
#include "evaluation/surface_distance.h"

namespace gnathion {

struct FieldOptions {
  double reach_mm = 3.0, rim_mm = 0.5, steep_deg = 60.0;
};

/// What is true of a scan by itself, wherever it lies: made once for all procedures that measure it.
struct ScanFacts {
  SharedMesh mesh;
  std::vector<Vector3> normals;
  std::vector<float> to_boundary_mm;
  std::vector<bool> used;  ///< by a triangle; loose vertices are no points of the surface
};
ScanFacts facts_of(SharedMesh scan, const FieldOptions& options);

/// `foreign`, per vertex (empty: none): points of another body, not measured.
DistanceField measure_field(const ScanFacts& scan, const SharedMesh& model, const SurfaceDistance& distance,
                            const Rigid3& dental_from_scan, const std::vector<bool>& foreign,
                            const FieldOptions& options);

/// Vertices of the scan that belong to `other` rather than to `own`: they lie on it, face as it does, and are
/// clearly nearer to it.
std::vector<bool> foreign_points(const ScanFacts& scan, const SurfaceDistance& own,
                                 const SurfaceDistance& other, const Rigid3& dental_from_scan,
                                 double reach_mm);

}  // namespace gnathion
