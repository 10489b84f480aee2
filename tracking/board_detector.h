// Corners of a calibration board in an image: found by OpenCV and libapriltag, refined by fitting the saddle
// that two crossing edges make (tracking/board_saddle.h).
#pragma once

#include <memory>
#include <string>

#include "core/calibration_board.h"
#include "core/image.h"

namespace gnathion {

struct BoardDetection {
  BoardView view;              ///< no corners: not found
  std::string reason;          ///< why not: "no chessboard of 9x6 inner corners"
  bool another_board = false;  ///< a board is there, but not the one that was said; `reason` says which
  double blur_px = 0;          ///< standard deviation of the edges' profile, median of the corners
  bool found() const { return !view.corners.empty(); }
};

/// One per thread. Same image, same corners.
class BoardDetector {
 public:
  static Result<std::unique_ptr<BoardDetector>> create(const CalibrationBoard& board);
  ~BoardDetector();
  /// A chessboard is found whole or not at all; of ChArUco and AprilGrid boards a part may be hidden.
  BoardDetection detect(const Image8& image);

 private:
  struct Impl;
  explicit BoardDetector(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace gnathion
