// The arch's undercuts along the splint's seating direction, as a mesh and as pictures.
#pragma once

#include <filesystem>

#include "core/result.h"
#include "design/splint.h"

namespace gnathion {

/// folder/undercut.ply (the arch's scan with undercut_mm per vertex), folder/pictures/undercut_left.png and
/// undercut_right.png.
Status draw_undercut_map(const SplintInputs& inputs, const SplintDesign& design,
                         const std::filesystem::path& folder);

}  // namespace gnathion
