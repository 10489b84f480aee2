// The last hundredths: where flat triangles cut through a crest of a tooth, the splint's vertices give way.
#pragma once

#include "core/mesh.h"
#include "core/mesh_query.h"
#include "design/splint_field.h"

namespace gnathion {

/// Moves vertices of `splint` (closed) out of the jaws until neither surface is deeper than about
/// `tolerance_mm` in the other, and until the way onto the supporting arch along a meets nothing deeper than r;
/// movements are of the order of voxel errors. Moves that would make the mesh cross itself are taken back.
void press_free_of_jaws(TriangleMesh& splint, const SplintField& field, double tolerance_mm);

}  // namespace gnathion
