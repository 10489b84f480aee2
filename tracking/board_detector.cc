#include "tracking/board_detector.h"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <map>
#include <optional>

#include "tracking/board_saddle.h"
#include "tracking/board_search.h"
#include "tracking/tag_detector.h"

namespace gnathion {
namespace {

using board::Marker;
using board::PlacedMarkers;
using board::RoughCorner;
using board::Vector2;

constexpr double kMostRadiusPx = 9;    // beyond, lens and perspective bend the edges
constexpr double kRadiusShare = 0.85;  // of what is clear around a corner

double radius_of(const CalibrationBoard& b, const RoughCorner& corner) {
  Eigen::Matrix2d jacobian;
  jacobian << corner.step_x, corner.step_y;
  const double least = Eigen::JacobiSVD<Eigen::Matrix2d>(jacobian).singularValues()[1];
  return std::min(kMostRadiusPx, kRadiusShare * board::clear_radius_mm(b) * least);
}

struct FittedCorner {
  RoughCorner rough;
  Saddle saddle;
};

std::vector<FittedCorner> fit_all(const Image8& image, const CalibrationBoard& b,
                                  const std::vector<RoughCorner>& rough) {
  std::vector<FittedCorner> fitted;
  for (const RoughCorner& corner : rough)
    if (const auto s = fit_saddle(image, corner.px, corner.step_x, corner.step_y, radius_of(b, corner)))
      fitted.push_back({corner, *s});
  return fitted;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

/// What the square toward +x, +y of a chessboard's corner is: 1 white, −1 black; the first corner's is black.
int colour_after(const CalibrationBoard& b, int id) {
  return (id / b.columns + id % b.columns) % 2 == 0 ? -1 : 1;
}

/// Whether the next row or column outside of the grid has corners, too: then the board is larger than was
/// said.
bool continues(const Image8& image, const CalibrationBoard& b, const std::vector<RoughCorner>& grid) {
  const auto at = [&](int c, int r) -> const RoughCorner& {
    return grid[static_cast<std::size_t>(r * b.columns + c)];
  };
  const auto beyond = [&](bool along_x, bool after) {
    const int count = along_x ? b.rows : b.columns;
    const int edge = after ? (along_x ? b.columns : b.rows) - 1 : 0, inner = after ? edge - 1 : 1;
    int seen = 0;
    for (int i = 0; i < count; ++i) {
      const RoughCorner& last = along_x ? at(edge, i) : at(i, edge);
      const RoughCorner& before = along_x ? at(inner, i) : at(i, inner);
      seen += fit_saddle(image, 2 * last.px - before.px, last.step_x, last.step_y, radius_of(b, last))
                  .has_value();
    }
    return 3 * seen >= 2 * count;
  };
  return beyond(true, false) || beyond(true, true) || beyond(false, false) || beyond(false, true);
}

void keep(const FittedCorner& f, int id, BoardDetection* out) {
  out->view.corners.push_back({id, f.saddle.px, f.saddle.covariance_px2});
}

double median_blur(const std::vector<FittedCorner>& fitted) {
  std::vector<double> blur;
  for (const FittedCorner& f : fitted) blur.push_back(f.saddle.blur_px);
  return median(std::move(blur));
}

BoardDetection detect_chessboard(const Image8& image, const CalibrationBoard& b) {
  BoardDetection out;
  const auto rough = board::find_chessboard(image, b);
  if (!rough) {
    out.reason = fmt::format("no chessboard of {}x{} inner corners", b.columns, b.rows);
    return out;
  }
  if (continues(image, b, *rough)) {
    out.reason = fmt::format("a chessboard with more than {}x{} inner corners", b.columns, b.rows);
    return out;
  }
  const std::vector<FittedCorner> fitted = fit_all(image, b, *rough);
  if (fitted.size() * 10 < rough->size() * 9) {
    out.reason = fmt::format("{} of {} corners are not clear (blur, glare, or too small)",
                             rough->size() - fitted.size(), rough->size());
    return out;
  }
  int agree = 0;
  for (const FittedCorner& f : fitted)
    agree += f.saddle.contrast_grey * colour_after(b, f.rough.id) > 0 ? 1 : -1;
  if (static_cast<std::size_t>(std::abs(agree)) != fitted.size()) {
    out.reason = "black and white do not alternate";
    return out;
  }
  const int last = b.columns * b.rows - 1;
  // Half a turn exchanges black and white where one of the two counts is odd; otherwise nothing tells.
  const bool turned = agree < 0 && !b.turns_unseen();
  for (const FittedCorner& f : fitted) keep(f, turned ? last - f.rough.id : f.rough.id, &out);
  if (turned) std::reverse(out.view.corners.begin(), out.view.corners.end());
  out.blur_px = median_blur(fitted);
  return out;
}

}  // namespace

struct BoardDetector::Impl {
  CalibrationBoard board;
  std::unique_ptr<board::MarkerFinder> finder;
  std::unique_ptr<TagDetector> edges;  ///< for tags without squares at their corners

  BoardDetection detect_markers(const Image8& image, const CameraModel& camera) {
    BoardDetection out;
    const std::vector<Marker> markers = finder->find(image);
    const char* kind = board.kind == BoardKind::kCharuco ? "marker" : "tag";
    const auto placed = board::place_markers(board, markers);
    if (!placed) {
      out.reason = markers.empty() ? fmt::format("no {} of {}", kind, board.family)
                                   : fmt::format("{} {}s of {}, but not as the board has them",
                                                 markers.size(), kind, board.family);
      return out;
    }
    const std::vector<RoughCorner> rough = board::rough_corners(board, markers, *placed);
    const std::vector<FittedCorner> fitted = fit_all(image, board, rough);
    const bool plain_tags = board.kind == BoardKind::kAprilGrid && fitted.size() * 4 < rough.size();
    if (plain_tags) {
      fit_tags(image, camera, markers, *placed, rough, &out);
    } else {
      for (const FittedCorner& f : fitted) keep(f, f.rough.id, &out);
      out.blur_px = median_blur(fitted);
    }
    if (out.view.corners.size() < kLeastCorners) {
      out.view.corners.clear();
      out.reason = fmt::format("the corners of {} {}s are not clear (blur, glare, or too small)",
                               markers.size(), kind);
    }
    return out;
  }

  /// Corners from the tags' own edges.
  void fit_tags(const Image8& image, const CameraModel& camera, const std::vector<Marker>& markers,
                const PlacedMarkers& placed, const std::vector<RoughCorner>& rough, BoardDetection* out) {
    out->from_edges = true;
    std::vector<double> blur;
    std::map<int, const RoughCorner*> by_id;
    for (const RoughCorner& r : rough) by_id[r.id] = &r;
    for (const std::size_t u : placed.used) {
      const auto tag = edges->follow(image, camera, markers[u].id, markers[u].px);
      if (!tag) continue;
      blur.push_back(tag->blur_px);
      for (int k = 0; k < 4; ++k) {
        // The tag's own corner k is the board's corner k + quarter_turns of this tag.
        const int id = 4 * tag->id + (k + placed.layout.quarter_turns) % 4;
        if (by_id.count(id))
          out->view.corners.push_back(
              {id, tag->corners_px[static_cast<std::size_t>(k)], tag->corner_covariance_px2(k)});
      }
    }
    out->blur_px = median(std::move(blur));
  }

  static constexpr std::size_t kLeastCorners = 8;
};

Result<std::unique_ptr<BoardDetector>> BoardDetector::create(const CalibrationBoard& b) {
  auto impl = std::make_unique<Impl>();
  impl->board = b;
  if (b.kind == BoardKind::kCharuco) {
    GNATHION_TRY(impl->finder, board::make_aruco_finder(b.family));
  } else if (b.kind == BoardKind::kAprilGrid) {
    impl->finder = board::make_tag36h11_finder(b.border_cells);
    GNATHION_TRY(impl->edges, TagDetector::create({}));
  }
  return std::unique_ptr<BoardDetector>(new BoardDetector(std::move(impl)));
}

BoardDetector::BoardDetector(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BoardDetector::~BoardDetector() = default;

BoardDetection BoardDetector::detect(const Image8& image, const CameraModel& camera) {
  return impl_->board.kind == BoardKind::kChessboard ? detect_chessboard(image, impl_->board)
                                                     : impl_->detect_markers(image, camera);
}

std::string BoardDetector::what_else(const Image8& image) {
  CalibrationBoard b = impl_->board;
  const auto chessboard = [&]() -> std::string {
    const auto [columns, rows] = board::measure_chessboard(image);
    return columns > 0 ? fmt::format("a chessboard of {}x{} inner corners", columns, rows) : std::string();
  };
  if (b.kind == BoardKind::kChessboard) return chessboard();
  Image8 mirrored = image;
  for (int y = 0; y < image.height_px; ++y)
    std::reverse(mirrored.pixels.begin() + static_cast<std::ptrdiff_t>(y) * image.width_px,
                 mirrored.pixels.begin() + static_cast<std::ptrdiff_t>(y + 1) * image.width_px);
  if (board::place_markers(b, impl_->finder->find(mirrored))) return "the mirror image of the board";
  const std::vector<Marker> markers = impl_->finder->find(image);
  for (int columns = 2; columns <= 30 && markers.size() >= 3; ++columns) {
    b.columns = columns;
    b.rows = 30;
    if (const auto placed = board::place_markers(b, markers); placed && placed->used.size() == markers.size())
      return fmt::format("a board that is {} {} wide", columns,
                         b.kind == BoardKind::kCharuco ? "squares" : "tags");
  }
  if (b.kind == BoardKind::kAprilGrid) {
    const int other = 3 - b.border_cells;
    const std::size_t count = board::make_tag36h11_finder(other)->find(image).size();
    if (count >= 3) return fmt::format("{} tags whose black border is {} cells wide", count, other);
  } else {
    for (const std::string& name : board::aruco_dictionaries()) {
      if (name == b.family) continue;
      auto finder = board::make_aruco_finder(name);
      const std::size_t count = finder ? (*finder)->find(image).size() : 0;
      if (count >= 4) return fmt::format("{} markers of the dictionary {}", count, name);
    }
  }
  return chessboard();
}

}  // namespace gnathion
