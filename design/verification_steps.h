// The single measurements behind SplintVerification. Meshes in the design frame; private to design/.
#pragma once

#include "design/splint_field.h"
#include "design/verification.h"

namespace gnathion {

/// The finished mesh with what the measurements share.
struct FinishedSplint {
  MeshQuery query;                 ///< the splint
  std::vector<SurfacePart> parts;  ///< of each vertex
  FinishedSplint(TriangleMesh mesh, const SplintField& field);
  const TriangleMesh& mesh() const { return query.mesh(); }
  /// Triangles whose three corners are of the given parts.
  TriangleMesh region(std::initializer_list<SurfacePart> wanted) const;
};

/// Topology, self-intersections, volume.
void verify_topology(const FinishedSplint& splint, SplintVerification& out);

/// Distance between the cavity's and the outer surface. `side_wall_p01_mm`: the 1st percentile where the
/// outer surface is not shaped by the mandible. `thickness_mm`: per vertex, negative on rims and walls of
/// apertures.
void verify_walls(const FinishedSplint& splint, const SplintField& field, SplintVerification& out,
                  double* side_wall_p01_mm, std::vector<float>* thickness_mm);

/// Undercuts of the arch as given, and what of them the cavity reaches.
void measure_retention(const FinishedSplint& splint, const SplintField& field,
                       const TriangleMesh& support_dental, const std::vector<std::uint8_t>& support_fdi,
                       Retention& out);

/// Gap to the teeth, penetration of both jaws, and what of the cavity holds below the height of contour.
/// `arch` wears the splint.
void verify_fit(const FinishedSplint& splint, const Preparation& preparation, Arch arch,
                SplintVerification& out);

/// Contacts of the opposing arch in TP, compared with the natural ones in MI, and the contact surface's
/// error.
void verify_contacts(const SplintInputs& inputs, const FinishedSplint& splint, const Preparation& preparation,
                     const SplintParameters& p, SplintVerification& out);

/// Depth of the opposing arch in the splint on its excursions; nothing where none were asked for.
void verify_freedom(const FinishedSplint& splint, const Preparation& preparation, SplintVerification& out);

/// Moves the splint along the seating direction onto its arch. `support_dental` is that arch's scan as given.
void verify_insertability(const FinishedSplint& splint, const Preparation& preparation,
                          const TriangleMesh& support_dental, SplintVerification& out);

/// Depth of the opposing arch's imprint beyond the natural relief, and its undercuts to the opening path.
void verify_imprint(const FinishedSplint& splint, const Preparation& preparation, const SplintParameters& p,
                    const TriangleMesh& support_dental, SplintVerification& out);

/// The tooth within 2 mm of a place, by the nearest vertex of the supporting arch's scan; or none.
std::vector<std::uint8_t> tooth_at(const Vector3& place_dental, const TriangleMesh& support_dental,
                                   const std::vector<std::uint8_t>& support_fdi);

/// Settles splint and opposing arch; fills predicted_seating or seating_note.
void verify_seating(const SplintInputs& inputs, const FinishedSplint& splint, const Preparation& preparation,
                    SplintVerification& out);

/// Apertures, from the film between cavity and opposing arch on the coarse grid. `support_dental` wears the
/// splint.
std::vector<Aperture> found_apertures(const SplintField& field, const TriangleMesh& support_dental,
                                      const std::vector<std::uint8_t>& support_fdi, Arch arch);
/// Cutouts drawn by hand, as apertures: area across a.
std::vector<Aperture> drawn_apertures(const SplintEdits& edits, const Rigid3& design_from_dental,
                                      const TriangleMesh& support_dental,
                                      const std::vector<std::uint8_t>& support_fdi);

}  // namespace gnathion
