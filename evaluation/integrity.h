// Is the printed splint sound: collisions with the teeth, gaps, wall thickness, planned beside printed.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/mesh_query.h"
#include "occlusion/arch.h"

namespace gnathion {

/// A plane through the arch where profiles are taken; in Dental. (SectionPlane is core/mesh_section.h's.)
struct ProfilePlane {
  std::string name;  ///< "canine_left", "molar_right", "palate", …
  Vector3 point_mm = Vector3::Zero();
  Vector3 normal = Vector3::UnitX();
  Vector3 up = Vector3::UnitZ();  ///< in the plane: from mandible to maxilla
};
/// Across the crowns at canines and first molars of both sides, and across the palate between the molars.
std::vector<ProfilePlane> standard_planes(const ArchFrame& frame, const TriangleMesh& maxilla,
                                          const std::vector<std::uint8_t>& maxilla_fdi);

struct Spread {
  std::size_t n = 0;
  double min_mm = 0.0, median_mm = 0.0, max_mm = 0.0;
};

/// One place along a profile: the splint's inner surface facing the maxilla.
struct ProfilePoint {
  double along_mm = 0.0;               ///< arc length along the planned inner surface in the plane
  Vector3 point_mm = Vector3::Zero();  ///< on the planned inner surface, Dental
  double planned_gap_mm = 0.0;         ///< to the maxilla's model; negative: inside
  double planned_wall_mm = 0.0;        ///< through the splint along the inner normal
  std::optional<double> printed_gap_mm, printed_wall_mm;  ///< where the scans show it
};
struct ProfileFigures {
  ProfilePlane plane;
  std::vector<ProfilePoint> points;
  Spread planned_gap, printed_gap, planned_wall, printed_wall;
};

/// Where one surface is inside another.
struct CollisionFigures {
  std::size_t points = 0;  ///< vertices of the splint that were asked
  double depth_mm = 0.0;   ///< deepest
  double area_mm2 = 0.0;   ///< deeper than the limit
  Vector3 where_mm = Vector3::Zero();
};

struct Integrity {
  double collision_limit_mm = 0.1;  ///< scans are not sharper
  /// Splint against maxilla and mandible (in TP); the scanned splint and jaws as they were found.
  CollisionFigures planned_maxilla, planned_mandible;
  std::optional<CollisionFigures> printed_maxilla, printed_mandible;
  std::size_t planned_self_intersections = 0;
  std::optional<std::size_t> printed_self_intersections;
  Spread planned_seat_gap;  ///< of the inner surface, all over
  std::optional<Spread> printed_seat_gap;
  std::vector<ProfileFigures> profiles;
};

}  // namespace gnathion
