// The one seam between instruments and everything above: devices, recordings and the phantom are
// sources, and nothing above can tell them apart.
#pragma once

#include <optional>

#include "core/result.h"
#include "core/sample.h"

namespace gnathion {

/// Pulled, never slept: next() blocks only as long as a live device needs. One thread at a time.
class Source {
 public:
  virtual ~Source() = default;
  /// The next sample in the order in which the host had it; nothing at the end. After an error the source is
  /// over.
  virtual Result<std::optional<Sample>> next() = 0;
};

}  // namespace gnathion
