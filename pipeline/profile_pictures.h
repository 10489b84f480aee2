// Pictures of a splint's profiles.
#pragma once

#include <filesystem>

#include "core/result.h"
#include "design/profiles.h"

namespace gnathion {

/// folder/profiles/NAME.svg for each profile, and folder/pictures/profiles.png with all of them on one sheet.
Status draw_profiles(const SplintInputs& inputs, const std::vector<SplintProfile>& profiles,
                     const std::filesystem::path& folder);

}  // namespace gnathion
