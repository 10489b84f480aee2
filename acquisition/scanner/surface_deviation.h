// How noisy a scan is, told by its own surface.
#pragma once

#include <cstddef>

#include "core/mesh.h"
#include "core/result.h"

namespace gnathion {

struct SurfaceDeviation {
  double sigma_mm = 0;      ///< 1σ along the normal, of a vertex about the smooth surface around it
  double radius_mm = 0;     ///< of the neighbourhoods
  std::size_t patches = 0;  ///< neighbourhoods that were measured
};

/// Fits a quadric z(x, y) to the neighbourhood of many vertices and takes the robust spread of what it
/// leaves, corrected for the six parameters. A quadric follows a face's curvature where a plane would count
/// it as noise. Sees what changes from vertex to vertex: errors that are smooth over the radius (scale,
/// calibration, a scanner's own smoothing) stay hidden; calibration finds those against the bow's model.
/// Deterministic. Error (kInput): fewer than 30 neighbourhoods with enough vertices.
Result<SurfaceDeviation> measure_surface_deviation(const TriangleMesh& mesh);

}  // namespace gnathion
