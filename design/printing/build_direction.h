// Which way up a splint is printed, so that no support stands in its cavity.
#pragma once

#include "core/mesh_query.h"
#include "design/write_ply.h"

namespace gnathion {

/// Surfaces that face the plate at less than `self_supporting_deg` against it need supports.
struct BuildDirection {
  Vector3 up = Vector3::UnitZ();     ///< unit, in the mesh's frame: away from the plate
  double overhang_mm2 = 0.0;         ///< of the whole surface
  double cavity_overhang_mm2 = 0.0;  ///< of the cavity
  /// Of overhangs elsewhere whose supports would stand in the cavity (the surface straight below is cavity).
  double standing_in_cavity_mm2 = 0.0;
  double height_mm = 0.0;  ///< of the part in this direction
};

constexpr double kSelfSupportingDeg = 45.0;

/// A tree of the same surface that stands elsewhere.
struct PlacedTree {
  const MeshQuery& query;
  Rigid3 query_from_mesh;
};

/// The facts of one direction. Rays for standing_in_cavity_mm2 only where asked.
BuildDirection overhang_along(const SplintSurface& splint, const Vector3& up, double self_supporting_deg,
                              bool with_rays = true);

/// Over directions of about 4°: least overhang, of which a square millimetre in the cavity (or supported
/// from there) counts as twenty elsewhere; of the three best by normals, those within 2 % of the surface, the
/// lowest part. The search starts from `cavity_opens` (unit, where the cavity opens to, the
/// seating direction), so that it turns with the splint. Deterministic. Builds a tree where none is given.
BuildDirection find_build_direction(const SplintSurface& splint, const Vector3& cavity_opens,
                                    double self_supporting_deg = kSelfSupportingDeg,
                                    const PlacedTree* tree = nullptr);

}  // namespace gnathion
