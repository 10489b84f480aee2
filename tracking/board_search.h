// Boards found roughly, to a pixel or so: where fits start. Internal to the board detector.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/calibration_board.h"
#include "core/image.h"

namespace gnathion::board {

using Vector2 = Eigen::Vector2d;

/// A corner before its fit. `step_x`, `step_y`: how far 1 mm along the board's x and y goes in the image, px.
struct RoughCorner {
  int id = 0;
  Vector2 px, step_x, step_y;
};

/// One marker in an image; corners in the order of BodyTag: lower left, lower right, upper right, upper left.
struct Marker {
  int id = 0;
  std::array<Vector2, 4> px;
};

/// The whole grid of inner corners, in the board's order, or nothing. The order turns with the board: x to y
/// is clockwise in the image.
std::optional<std::vector<RoughCorner>> find_chessboard(const Image8& image, const CalibrationBoard& board);
/// Columns × rows of inner corners of whatever chessboard is there ({0, 0}: none).
std::array<int, 2> measure_chessboard(const Image8& image);

/// How far around a corner nothing else is printed, mm.
double clear_radius_mm(const CalibrationBoard& board);

/// Finds the markers of one dictionary or family. One thread at a time.
class MarkerFinder {
 public:
  virtual ~MarkerFinder() = default;
  virtual std::vector<Marker> find(const Image8& image) = 0;
};
Result<std::unique_ptr<MarkerFinder>> make_aruco_finder(const std::string& dictionary);
std::unique_ptr<MarkerFinder> make_tag36h11_finder(int border_cells);
const std::vector<std::string>& aruco_dictionaries();

/// How the board's markers lie, as the image shows it.
struct MarkerLayout {
  int first_white =
      1;  ///< ChArUco: 1: the upper left square is black; 0: white (old boards with an even number of rows)
  int quarter_turns = 0;  ///< of each marker against its place on the board
};
/// Which layout the markers obey, and which of them (indices); nothing where none does.
struct PlacedMarkers {
  MarkerLayout layout;
  std::vector<std::size_t> used;
};
std::optional<PlacedMarkers> place_markers(const CalibrationBoard& board, const std::vector<Marker>& markers);
/// Corners that the placed markers allow to predict.
std::vector<RoughCorner> rough_corners(const CalibrationBoard& board, const std::vector<Marker>& markers,
                                       const PlacedMarkers& placed);

}  // namespace gnathion::board
