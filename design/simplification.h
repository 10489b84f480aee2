// The splint's surface with fewer triangles: as fine as extracted only where teeth are sharp.
#pragma once

#include "core/mesh.h"
#include "design/splint_field.h"

namespace gnathion {

/// Within 0.003 mm of the extracted surface on teeth, 0.01 mm elsewhere. About tips and crests of either jaw
/// nothing is removed (long triangles would cut them), nor where the simpler mesh would cross itself.
TriangleMesh simplified(TriangleMesh mesh, const SplintField& field);

}  // namespace gnathion
