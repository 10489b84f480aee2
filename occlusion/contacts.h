// Gaps, contacts and overlap between two jaw surfaces (or a jaw and a splint).
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh_query.h"
#include "occlusion/arch.h"

namespace gnathion {

/// Whether a point is inside a surface that may be open (scan holes, no base). Far from boundaries the
/// pseudonormal decides; where the closest feature is a boundary, rays decide by majority, the one
/// along `outward` (from the solid towards the opposing jaw) first.
bool inside_surface(const MeshQuery& surface, const Vector3& p_mm, const Vector3& outward);

/// A small piece of a triangle, for integrals over a surface that are finer than its triangles.
struct SurfaceSample {
  Vector3 p_mm;  ///< in the frame of the mesh
  double area_mm2 = 0.0;
  std::uint32_t triangle = 0;
  std::uint32_t vertex = 0;  ///< corner that weighs most at p, for labels
};
/// The wanted triangles (empty: all) cut into equal pieces with edges no longer than step_mm.
std::vector<SurfaceSample> sample_surface(const TriangleMesh& mesh, double step_mm,
                                          const std::vector<bool>& triangle_wanted = {});

/// Signed distance from each (displaced) point to `surface`: negative inside, +infinity beyond
/// max_mm, on either side. In parallel; the result does not depend on the number of threads.
std::vector<double> signed_gaps_mm(const std::vector<Vector3>& points_mm, const Rigid3& motion,
                                   const MeshQuery& surface, const Vector3& outward, double max_mm);

struct Overlap {
  static constexpr double kSearchMm = 3.0;  ///< default reach
  double maxilla_depth_mm = 0.0;            ///< deepest point of the maxilla's surface inside the mandible
  double mandible_depth_mm = 0.0;           ///< deepest point of the mandible's surface inside the maxilla
  double depth_mm = 0.0;                    ///< the larger of the two; 0 if they are apart
  Vector3 where_mm = Vector3::Zero();       ///< of that point, in Dental (mandible displaced)
  double area_mm2 = 0.0;                    ///< of the second surface that is inside the first
  double volume_mm3 = 0.0;                  ///< approximate: depth integrated over that area
  double min_distance_mm = 0.0;             ///< 0 when overlapping; capped at the search distance
  Vector3 closest_mm = Vector3::Zero();     ///< where the distance is smallest, on the second surface
};
/// How the second surface, displaced by `motion`, overlaps the first. `up` as in ArchFrame, maxilla first.
/// Both surfaces are sampled at step_mm.
Overlap find_overlap(const MeshQuery& maxilla, const MeshQuery& mandible, const Rigid3& motion,
                     const Vector3& up, double step_mm = 0.25, double search_mm = Overlap::kSearchMm);

struct ContactPatch {
  Vector3 centre_mm = Vector3::Zero();  ///< displaced, in Dental
  double area_mm2 = 0.0;
  std::uint8_t fdi = 0;  ///< tooth with most of the area; 0 unknown
};
struct ToothArea {
  std::uint8_t fdi = 0;
  double area_mm2 = 0.0;
};
struct Contacts {
  std::vector<ContactPatch> patches;  ///< connected, largest first
  std::vector<ToothArea> per_tooth;   ///< by FDI number, ascending, without 0
  double area_mm2 = 0.0;
  double left_area_mm2 = 0.0, right_area_mm2 = 0.0;  ///< by the side of the midline
  double front_area_mm2 = 0.0;                       ///< on incisors and canines (labels needed)
  std::vector<SurfaceSample> samples;                ///< the contact area itself, undisplaced
};
/// Where `surface`, displaced by `motion`, is no farther than limit_mm from `opposing` or inside it.
/// `fdi_of_vertex` labels the surface (may be empty); `outward` points out of `opposing` towards the surface.
Contacts find_contacts(const TriangleMesh& surface, const std::vector<std::uint8_t>& fdi_of_vertex,
                       const Rigid3& motion, const MeshQuery& opposing, const Vector3& outward,
                       const ArchFrame& frame, double limit_mm = 0.05, double step_mm = 0.25);

/// Room between the jaws at one tooth of the mandible.
struct ToothClearance {
  std::uint8_t fdi = 0;
  double min_mm =
      0.0;  ///< smallest distance to the maxilla; negative inside, and where the tooth is above it
  Vector3 where_mm = Vector3::Zero();  ///< of that point of the mandible, displaced
  std::uint8_t opposing_fdi = 0;       ///< maxillary tooth there
  double vertical_median_mm =
      0.0;  ///< median height of the maxilla over the occlusal surface, along the occlusal normal
  double opposed_fraction = 0.0;  ///< of the tooth's occlusal area that has the maxilla over or under it
};
/// Tooth by tooth, mandible displaced by `motion`; distances are searched up to max_mm.
std::vector<ToothClearance> tooth_clearances(const MeshQuery& maxilla,
                                             const std::vector<std::uint8_t>& maxilla_fdi,
                                             const TriangleMesh& mandible,
                                             const std::vector<std::uint8_t>& mandible_fdi,
                                             const Rigid3& motion, const ArchFrame& frame,
                                             double max_mm = 60.0);

}  // namespace gnathion
