// Corners of a calibration board in an image: found by OpenCV and libapriltag, refined by fitting the saddle
// that two crossing edges make (tracking/board_saddle.h).
#pragma once

#include <memory>
#include <string>

#include "core/calibration_board.h"
#include "core/camera_model.h"
#include "core/image.h"

namespace gnathion {

struct BoardDetection {
  BoardView view;           ///< no corners: not found
  std::string reason;       ///< why not: "no chessboard of 9x6 inner corners"
  double blur_px = 0;       ///< standard deviation of the edges' profile, median of the corners
  bool from_edges = false;  ///< corners from tags' edges: better once the lens is known
  bool found() const { return !view.corners.empty(); }
};

/// One per thread. Same image, same corners.
class BoardDetector {
 public:
  static Result<std::unique_ptr<BoardDetector>> create(const CalibrationBoard& board);
  ~BoardDetector();
  /// A chessboard is found whole or not at all; of ChArUco and AprilGrid boards a part may be hidden.
  /// `camera`: the lens as far as it is known; only tags without squares at their corners ask for it.
  BoardDetection detect(const Image8& image, const CameraModel& camera = {});
  /// For an image in which the board was not found: what there is instead ("a chessboard of 9x6 inner
  /// corners", "the mirror image of the board"); empty where there is nothing. Slow.
  std::string what_else(const Image8& image);

 private:
  struct Impl;
  explicit BoardDetector(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace gnathion
