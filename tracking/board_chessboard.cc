#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>

#include "tracking/board_search.h"

namespace gnathion::board {
namespace {

cv::Mat as_mat(const Image8& image) {
  return {image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(image.pixels.data())};
}

/// Half of the step over the neighbours on both sides, or the step to the one neighbour there is.
Vector2 step(const std::vector<Vector2>& px, int at, int stride, int place, int count) {
  const int low = place > 0 ? at - stride : at, high = place + 1 < count ? at + stride : at;
  return (px[static_cast<std::size_t>(high)] - px[static_cast<std::size_t>(low)]) / ((high - low) / stride);
}

constexpr int kSearchWidthPx = 1600, kSlowSearchWidthPx = 960;

/// Corners of a search in the image, scaled down to `most_px` of width where it is larger; none where nothing
/// is found.
template <class Find>
std::vector<Vector2> search(const Image8& image, int most_px, const Find& find) {
  const double scale = std::min(1.0, static_cast<double>(most_px) / image.width_px);
  std::vector<cv::Point2f> found;
  try {
    cv::Mat mat = as_mat(image), small;
    if (scale < 1) cv::resize(mat, small, cv::Size(), scale, scale, cv::INTER_AREA);
    if (!find(scale < 1 ? small : mat, &found)) return {};
  } catch (const cv::Exception&) {
    return {};  // images of a few pixels
  }
  std::vector<Vector2> px;
  for (const cv::Point2f& p : found)
    px.emplace_back((static_cast<double>(p.x) + 0.5) / scale - 0.5,
                    (static_cast<double>(p.y) + 0.5) / scale - 0.5);
  return px;
}

double cross(const Vector2& a, const Vector2& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

std::optional<std::vector<RoughCorner>> find_chessboard(const Image8& image, const CalibrationBoard& board) {
  const cv::Size size(board.columns, board.rows);
  const auto classic = [&](const cv::Mat& mat, std::vector<cv::Point2f>* corners) {
    return cv::findChessboardCorners(mat, size, *corners,
                                     cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE);
  };
  const auto by_sectors = [&](const cv::Mat& mat, std::vector<cv::Point2f>* corners) {
    return cv::findChessboardCornersSB(mat, size, *corners, cv::CALIB_CB_NORMALIZE_IMAGE);
  };
  std::vector<Vector2> px = search(image, kSearchWidthPx, classic);
  if (px.empty()) px = search(image, kSlowSearchWidthPx, by_sectors);
  if (px.size() != static_cast<std::size_t>(size.area())) return std::nullopt;
  const int columns = board.columns, rows = board.rows;
  double turn = 0;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c)
      turn += cross(step(px, r * columns + c, 1, c, columns), step(px, r * columns + c, columns, r, rows));
  if (turn < 0)
    for (int r = 0; r < rows; ++r) std::reverse(px.begin() + r * columns, px.begin() + (r + 1) * columns);
  std::vector<RoughCorner> corners;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c) {
      const int at = r * columns + c;
      corners.push_back({at, px[static_cast<std::size_t>(at)], step(px, at, 1, c, columns) / board.square_mm,
                         step(px, at, columns, r, rows) / board.square_mm});
    }
  return corners;
}

namespace {
/// The board that OpenCV grows from at least `least` inner corners; zeros: none.
std::array<int, 2> grown_chessboard(const Image8& image, std::array<int, 2> least) {
  cv::Mat corners, meta;
  try {
    if (cv::findChessboardCornersSB(
            as_mat(image), cv::Size(least[0], least[1]), corners,
            cv::CALIB_CB_LARGER | cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE, meta))
      return {std::max(meta.cols, meta.rows), std::min(meta.cols, meta.rows)};
  } catch (const cv::Exception&) {
  }
  return {0, 0};
}
}  // namespace

std::array<int, 2> measure_chessboard(const Image8& image) {
  constexpr int kLargest = 30;
  std::array<int, 2> found = grown_chessboard(image, {3, 3});
  // It stops at the first board that it can close, now and then short of the whole: larger ones are asked
  // for.
  for (bool more = found[0] > 0; more && found[0] < kLargest;) {
    more = false;
    for (const std::array<int, 2>& least :
         {std::array<int, 2>{found[0] + 1, found[1]}, {found[0], found[1] + 1}}) {
      const std::array<int, 2> larger = grown_chessboard(image, least);
      if (larger[0] * larger[1] <= found[0] * found[1]) continue;
      found = larger;
      more = true;
      break;
    }
  }
  return found;
}

}  // namespace gnathion::board
