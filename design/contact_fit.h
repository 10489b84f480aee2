// Contacts to the micrometre: triangles between vertices on a curved surface lie beside it.
#pragma once

#include "core/mesh.h"
#include "design/splint_field.h"

namespace gnathion {

/// Moves the vertices where the opposing arch may touch, so that the flat triangles between them lie on the
/// field's surface in the mean. Chords of a cusp of 1 mm radius are 0.001 mm low at voxels of 0.1 mm, and
/// a contact, which ends at a gap of 0.05 mm, loses a fiftieth of its area by that. Moves are less than a
/// tenth of a voxel, and none makes the mesh, which must not cross itself, do so.
void fit_contacts(TriangleMesh& splint, const SplintField& field);

}  // namespace gnathion
