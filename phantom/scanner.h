// Simulated 3D scanners: a true surface in, a scan with a scanner's faults out.
#pragma once

#include <optional>
#include <vector>

#include "core/mesh.h"
#include "core/random.h"

namespace gnathion {

struct ScannerModel {
  double edge_mm = 0.3;                ///< grid of the re-tessellation
  double white_noise_mm = 0.01;        ///< along normals, 1 sigma
  double correlated_noise_mm = 0.015;  ///< along normals, 1 sigma
  double correlation_length_mm = 10;
  double scale_error = 0.0005;             ///< lengths come out (1 + scale_error) times the truth
  std::optional<Vector3> scale_centre_mm;  ///< in the surface's frame; default: its centroid
  int holes = 6;
  double hole_radius_min_mm = 0.4, hole_radius_max_mm = 1.2;
  double rim_trim_mm = 0.5;  ///< nothing nearer to an open rim than this
  /// Directions from the surface to the scanner; a part is seen when one of them is within
  /// `max_incidence_deg` of its normal and nothing lies on the way for `reach_mm`.
  std::vector<Vector3> views;
  double reach_mm = 15;
  double max_incidence_deg = 75;
  std::size_t smallest_component = 60;  ///< triangles; smaller islands are dropped
};

/// Wand moved over the arch: from the occlusal side and all around it. `occlusal` points away from the gums.
ScannerModel intraoral_scanner(const Vector3& occlusal);
/// Structured light from in front, the sides, above and below; `front` points out of the face, `up` to the
/// crown.
ScannerModel face_scanner(const Vector3& front, const Vector3& up);

/// The scan, in its own frame. Vertices lie on the true surface but for noise (in its sharpest creases a
/// little beside it), and none is a source vertex.
TriangleMesh simulate_scan(const TriangleMesh& surface, const ScannerModel& model,
                           const Rigid3& scan_from_surface, Random& random);

}  // namespace gnathion
