#pragma once

namespace gnathion {
inline constexpr const char* kVersion = "0.1.0";
}  // namespace gnathion
