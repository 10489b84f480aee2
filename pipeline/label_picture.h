// A picture of what is embossed on the splint.
#pragma once

#include <filesystem>

#include "core/result.h"
#include "design/splint.h"

namespace gnathion {

/// folder/pictures/label.png, from straight before the label; nothing where there is none.
Status draw_label(const SplintDesign& design, const std::filesystem::path& folder);

}  // namespace gnathion
