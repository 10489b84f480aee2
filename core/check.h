// Checks for bugs: always on, in every build; a failed one prints where and aborts.
#pragma once

namespace gnathion {
[[noreturn]] void check_failed(const char* condition, const char* file, int line);
}  // namespace gnathion

#define GNATHION_CHECK(condition) \
  ((condition) ? void(0) : ::gnathion::check_failed(#condition, __FILE__, __LINE__))
