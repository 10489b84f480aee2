// Boards in many images: files read, corners found on several threads.
#pragma once

#include <filesystem>
#include <functional>
#include <vector>

#include "core/progress.h"
#include "tracking/board_detector.h"

namespace gnathion {

/// Image files of a folder in the order of their names (img2 after img10 does not matter here). Refuses a
/// folder that is not there or holds no image.
Result<std::vector<std::filesystem::path>> list_images(const std::filesystem::path& folder);
/// Colour becomes grey.
Result<Image8> read_grey_image(const std::filesystem::path& path);

/// Image `i`; called from several threads.
using ImageLoader = std::function<Result<Image8>(std::size_t i)>;

/// Detections in order, on any number of threads the same. Refused: what a loader refuses, and an image of
/// another size than the first (`name(i)` says which).
struct BoardDetections {
  int width_px = 0, height_px = 0;
  std::vector<BoardDetection> images;
};
Result<BoardDetections> detect_boards(const CalibrationBoard& board, std::size_t count,
                                      const ImageLoader& load,
                                      const std::function<std::string(std::size_t)>& name,
                                      const CameraModel& camera, Progress& progress);

}  // namespace gnathion
