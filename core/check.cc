#include "core/check.h"

#include <cstdio>
#include <cstdlib>

namespace gnathion {

void check_failed(const char* condition, const char* file, int line) {
  std::fprintf(stderr, "gnathion: internal check failed: %s:%d: %s\n", file, line, condition);
  std::abort();
}

}  // namespace gnathion
