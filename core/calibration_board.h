// Boards that cameras are calibrated with: where their corners are, and what an image showed of them.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "core/result.h"
#include "core/rigid.h"

namespace gnathion {

enum class BoardKind { kChessboard, kCharuco, kAprilGrid };

/// A flat board. Its frame: x along the columns, y along the rows, z = 0, right-handed with z away from a
/// camera that sees the print.
struct CalibrationBoard {
  BoardKind kind = BoardKind::kChessboard;
  int columns = 9, rows = 6;  ///< chessboard: inner corners; ChArUco: squares; AprilGrid: tags
  double square_mm = 25;      ///< side of a square; AprilGrid: side of a tag's black square
  double marker_mm = 0;       ///< ChArUco: side of a marker's black square
  double gap = 0;             ///< AprilGrid: gap between tags over the tag's side (Kalibr's tagSpacing)
  std::string family;         ///< ChArUco: dictionary, "4X4_50"; AprilGrid: "tag36h11"
  int border_cells = 1;       ///< AprilGrid: width of the tags' black border (old Kalibr sheets: 2)

  /// "chessboard:9x6:25", "charuco:7x5:30:22:4X4_50", "aprilgrid:6x6:30:0.3", as parse_board reads it.
  std::string text() const;
  /// Every corner by its id, mm. Chessboard and ChArUco: inner corners row by row. AprilGrid: four a tag, in
  /// the order of BodyTag; tag 0 is the lower left one, ids run to the right, then up.
  std::vector<Vector3> points_mm() const;
  /// Looks the same when turned by half a turn, so that an image does not tell which corner is the first.
  bool turns_unseen() const;
};

/// Refuses (kUsage) what is not a board, saying the forms.
Result<CalibrationBoard> parse_board(const std::string& text);

/// One corner in one image; pixel (0, 0) is the centre of the upper left pixel.
struct BoardCorner {
  int id = 0;
  Eigen::Vector2d px = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance_px2 = Eigen::Matrix2d::Identity();
};

/// The board in one image.
struct BoardView {
  std::string name;  ///< file name, or the frame's time
  std::vector<BoardCorner> corners;
};

}  // namespace gnathion
