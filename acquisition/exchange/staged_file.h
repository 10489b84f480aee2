// A recording that appears under its name only when it is whole.
#pragma once

#include <filesystem>
#include <functional>

#include "acquisition/recording.h"

namespace gnathion {

/// Runs `fill` on a recording beside `out`, finishes it and renames it; whatever fails leaves nothing behind.
Status write_whole_recording(const std::filesystem::path& out,
                             const std::function<Status(RecordingWriter&)>& fill);

}  // namespace gnathion
