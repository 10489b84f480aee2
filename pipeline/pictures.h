// The pictures that a design and a session leave behind.
#pragma once

#include <filesystem>

#include "core/result.h"
#include "design/splint.h"
#include "rendering/plot.h"
#include "tracking/motion_file.h"

namespace gnathion {

/// splint_on_maxilla.png (or _mandible), splint_cavity.png, jaws_in_tp.png, jaws_in_tp_right.png, section_molar.png, section_premolar.png and
/// section_incisor.png into `folder` (made if needed).
Status draw_design(const SplintInputs& inputs, const SplintDesign& design,
                   const std::filesystem::path& folder);

/// jaw_path.png: the incisal point's way, seen from the side, from the front, and over time.
Status draw_jaw_path(const JawMotion& motion, const Vector3& incisal_point_mm, const ArchFrame& frame,
                     const std::filesystem::path& folder);

/// Vertical plane across the arch at a tooth-sized place: `s_mm` along the arch curve from the midline, the
/// patient's left positive. x points outwards (buccal), y up.
SectionPlane arch_section(const ArchFrame& frame, double s_mm);

}  // namespace gnathion
