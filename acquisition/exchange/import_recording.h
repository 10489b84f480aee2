// Recordings from what others filmed or tracked: image folders, videos, PLUS sequences. docs/exchange.md.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/progress.h"
#include "core/result.h"

namespace gnathion {

/// One camera's pictures: a folder, or a video file.
struct ImageImport {
  std::string stream;  ///< "camera_0"
  std::filesystem::path path;
};

struct ImportSummary {
  std::size_t frames = 0, poses = 0, rejected = 0;
  std::vector<std::string> notes;  ///< "camera_0: the video says 30 Hz; 60 Hz was asked for and taken"
};

/// Images in natural order (img2 before img10), frame i of every stream at i / rate_hz from time 0 (the
/// counter is i). What the files' numbers leave out, and what a video announces and does not give, is missing
/// in the ledger. Without a rate a video's own is taken; a folder needs one. Refused by name: a picture of
/// another size or depth than the first, one that cannot be read, 16-bit pictures. Colour becomes grey
/// (BT.601). Whole or not at all; the same pictures give the same bytes.
Result<ImportSummary> import_images(const std::vector<ImageImport>& streams, std::optional<double> rate_hz,
                                    const std::filesystem::path& out, Progress& progress);

/// A PLUS sequence: every transform becomes a stream of poses named as in the file ("StylusToTracker"), 8-bit
/// images the stream `image_stream`. What is no rigid motion is rejected with a line in the ledger.
Result<ImportSummary> import_plus_sequence(const std::filesystem::path& path, const std::string& image_stream,
                                           std::optional<double> rate_hz, const std::filesystem::path& out,
                                           Progress& progress);

}  // namespace gnathion
