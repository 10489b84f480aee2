// Grey pictures as PNG.
#pragma once

#include <string>

#include "core/image.h"
#include "core/result.h"

namespace gnathion {

Result<std::string> png_bytes(const Image8& image);

}  // namespace gnathion
