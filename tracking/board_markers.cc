#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>

#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <map>

#include "tracking/board_search.h"

namespace gnathion::board {
namespace {

class ArucoFinder final : public MarkerFinder {
 public:
  explicit ArucoFinder(int dictionary)
      : dictionary_(cv::aruco::getPredefinedDictionary(dictionary)),
        parameters_(cv::aruco::DetectorParameters::create()) {}
  std::vector<Marker> find(const Image8& image) override {
    const cv::Mat mat(image.height_px, image.width_px, CV_8UC1,
                      const_cast<std::uint8_t*>(image.pixels.data()));
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    try {
      cv::aruco::detectMarkers(mat, dictionary_, corners, ids, parameters_);
    } catch (const cv::Exception&) {
      return {};  // images of a few pixels
    }
    std::vector<Marker> markers;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      Marker m;
      m.id = ids[i];
      for (std::size_t k = 0; k < 4; ++k)  // ArUco's order starts at the upper left, clockwise
        m.px[k] = {static_cast<double>(corners[i][3 - k].x), static_cast<double>(corners[i][3 - k].y)};
      markers.push_back(m);
    }
    std::sort(markers.begin(), markers.end(), [](const Marker& a, const Marker& b) { return a.id < b.id; });
    return markers;
  }

 private:
  cv::Ptr<cv::aruco::Dictionary> dictionary_;
  cv::Ptr<cv::aruco::DetectorParameters> parameters_;
};

class TagFinder final : public MarkerFinder {
 public:
  explicit TagFinder(int border_cells) : family_(tag36h11_create()), detector_(apriltag_detector_create()) {
    const int more = border_cells - 1;
    family_->width_at_border += 2 * more;
    family_->total_width += 2 * more;
    for (std::uint32_t i = 0; i < family_->nbits; ++i) {
      family_->bit_x[i] += static_cast<std::uint32_t>(more);
      family_->bit_y[i] += static_cast<std::uint32_t>(more);
    }
    detector_->quad_decimate = 1;
    detector_->nthreads = 1;
    apriltag_detector_add_family_bits(detector_, family_, 1);
  }
  ~TagFinder() override {
    apriltag_detector_destroy(detector_);
    tag36h11_destroy(family_);
  }
  TagFinder(const TagFinder&) = delete;
  TagFinder& operator=(const TagFinder&) = delete;

  std::vector<Marker> find(const Image8& image) override {
    if (image.width_px < 16 || image.height_px < 16) return {};
    std::vector<Marker> markers = find_in(image);
    // Squares that touch the tags at their corners grow together with them where the image is blurred. One
    // pixel less of black parts them; corners are a pixel off then, which is good enough to start from.
    Image8 lean(image.width_px, image.height_px);
    const cv::Mat from(image.height_px, image.width_px, CV_8UC1,
                       const_cast<std::uint8_t*>(image.pixels.data()));
    cv::Mat to(image.height_px, image.width_px, CV_8UC1, lean.pixels.data());
    cv::dilate(from, to, cv::Mat());
    for (const Marker& m : find_in(lean)) {
      const bool known =
          std::any_of(markers.begin(), markers.end(), [&](const Marker& k) { return k.id == m.id; });
      if (!known) markers.push_back(m);
    }
    std::sort(markers.begin(), markers.end(), [](const Marker& a, const Marker& b) {
      return a.id != b.id ? a.id < b.id : a.px[0].x() < b.px[0].x();
    });
    return markers;
  }

 private:
  std::vector<Marker> find_in(const Image8& image) {
    image_u8_t view = {image.width_px, image.height_px, image.width_px,
                       const_cast<std::uint8_t*>(image.pixels.data())};
    zarray_t* found = apriltag_detector_detect(detector_, &view);
    std::vector<Marker> markers;
    for (int i = 0; i < zarray_size(found); ++i) {
      apriltag_detection_t* d = nullptr;
      zarray_get(found, i, &d);
      Marker m;
      m.id = d->id;
      // libapriltag counts from the upper left corner of the upper left pixel, we from its centre.
      for (std::size_t k = 0; k < 4; ++k) m.px[k] = {d->p[k][0] - 0.5, d->p[k][1] - 0.5};
      markers.push_back(m);
    }
    apriltag_detections_destroy(found);
    return markers;
  }

  apriltag_family_t* family_;
  apriltag_detector_t* detector_;
};

/// The four corners of a marker on the board, in the order of BodyTag; nothing for an id that the board has
/// not.
std::optional<std::array<Vector2, 4>> place_of(const CalibrationBoard& board, int id,
                                               const MarkerLayout& layout) {
  std::array<Vector2, 4> corners;
  double left = 0, lower = 0, side = board.square_mm;
  if (board.kind == BoardKind::kAprilGrid) {
    if (id < 0 || id >= board.columns * board.rows) return std::nullopt;
    const double pitch = board.square_mm * (1 + board.gap);
    left = (id % board.columns) * pitch;
    lower = -(id / board.columns) * pitch;
  } else {
    // White squares carry the markers, numbered row by row. The first inner corner is the origin.
    int count = -1, row = 0, column = 0;
    for (row = 0; row < board.rows; ++row) {
      for (column = 0; column < board.columns; ++column)
        if ((row + column) % 2 == layout.first_white && ++count == id) break;
      if (count == id) break;
    }
    if (id < 0 || count != id) return std::nullopt;
    side = board.marker_mm;
    const double margin = (board.square_mm - side) / 2;
    left = (column - 1) * board.square_mm + margin;
    lower = row * board.square_mm - margin;
  }
  const std::array<Vector2, 4> square = {Vector2(left, lower), Vector2(left + side, lower),
                                         Vector2(left + side, lower - side), Vector2(left, lower - side)};
  for (std::size_t k = 0; k < 4; ++k)
    corners[k] = square[(k + static_cast<std::size_t>(layout.quarter_turns)) % 4];
  return corners;
}

Matrix3 homography(const std::vector<cv::Point2d>& from, const std::vector<cv::Point2d>& to, bool* good) {
  Matrix3 h = Matrix3::Identity();
  *good = false;
  try {
    const cv::Mat m = cv::findHomography(from, to, 0);
    if (m.rows != 3) return h;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) h(r, c) = m.at<double>(r, c);
    *good = h.allFinite();
  } catch (const cv::Exception&) {
  }
  return h;
}

double side_px(const Marker& m) {
  double length = 0;
  for (std::size_t k = 0; k < 4; ++k) length += (m.px[(k + 1) % 4] - m.px[k]).norm() / 4;
  return length;
}

/// Markers that lie where one plane and this layout put them; the two markers that start it are tried in
/// turn.
std::vector<std::size_t> obeying(const CalibrationBoard& board, const std::vector<Marker>& markers,
                                 const MarkerLayout& layout) {
  std::vector<std::optional<std::array<Vector2, 4>>> places;
  for (const Marker& m : markers) places.push_back(place_of(board, m.id, layout));
  std::vector<std::size_t> best;
  for (std::size_t start = 0; start < std::min<std::size_t>(markers.size(), 12); ++start) {
    std::vector<std::size_t> used = {start};
    if (!places[start]) continue;
    // Grows from the nearest markers on: the lens bends a large board, but hardly its next marker.
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < markers.size(); ++i)
      if (i != start && places[i]) order.push_back(i);
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return ((*places[a])[0] - (*places[start])[0]).norm() < ((*places[b])[0] - (*places[start])[0]).norm();
    });
    for (const std::size_t i : order) {
      std::vector<cv::Point2d> from, to;
      for (const std::size_t u : used)
        for (std::size_t k = 0; k < 4; ++k) {
          from.emplace_back((*places[u])[k].x(), (*places[u])[k].y());
          to.emplace_back(markers[u].px[k].x(), markers[u].px[k].y());
        }
      bool good = false;
      const Matrix3 h = homography(from, to, &good);
      double off = 0;
      for (std::size_t k = 0; k < 4; ++k)
        off = std::max(
            off, ((h * Vector3((*places[i])[k].x(), (*places[i])[k].y(), 1)).hnormalized() - markers[i].px[k])
                     .norm());
      if (good && off < 0.5 * side_px(markers[i])) used.push_back(i);
    }
    if (used.size() > best.size()) best = used;
    if (best.size() * 10 >= markers.size() * 8) break;
  }
  std::sort(best.begin(), best.end());
  return best;
}

}  // namespace

const std::vector<std::string>& aruco_dictionaries() {
  static const std::vector<std::string> names = {
      "4X4_50",        "4X4_100",        "4X4_250",       "4X4_1000", "5X5_50",         "5X5_100",
      "5X5_250",       "5X5_1000",       "6X6_50",        "6X6_100",  "6X6_250",        "6X6_1000",
      "7X7_50",        "7X7_100",        "7X7_250",       "7X7_1000", "ARUCO_ORIGINAL", "APRILTAG_16h5",
      "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11"};
  return names;
}

Result<std::unique_ptr<MarkerFinder>> make_aruco_finder(const std::string& dictionary) {
  const auto& names = aruco_dictionaries();
  const auto found = std::find(names.begin(), names.end(), dictionary);
  if (found == names.end())
    return fail(
        ErrorCode::kUsage, "cannot read board", dictionary,
        "no such ArUco dictionary; known are 4X4_50, 4X4_100, … 7X7_1000, ARUCO_ORIGINAL, APRILTAG_36h11");
  return std::unique_ptr<MarkerFinder>(new ArucoFinder(static_cast<int>(found - names.begin())));
}

std::unique_ptr<MarkerFinder> make_tag36h11_finder(int border_cells) {
  return std::make_unique<TagFinder>(border_cells);
}

std::optional<PlacedMarkers> place_markers(const CalibrationBoard& board,
                                           const std::vector<Marker>& markers) {
  constexpr std::size_t kLeastMarkers = 3;
  if (markers.size() < kLeastMarkers) return std::nullopt;
  PlacedMarkers best;
  // A board of ours stands upright; Kalibr's sheets print each tag turned by half a turn.
  const bool charuco = board.kind == BoardKind::kCharuco;
  for (const int first_white : {1, 0})
    for (int turns = 0; turns < (charuco ? 1 : 4); ++turns) {
      if (!charuco && first_white == 0) continue;
      const MarkerLayout layout{first_white, turns};
      std::vector<std::size_t> used = obeying(board, markers, layout);
      if (used.size() > best.used.size()) best = {layout, std::move(used)};
    }
  if (best.used.size() < kLeastMarkers || 2 * best.used.size() < markers.size()) return std::nullopt;
  return best;
}

std::vector<RoughCorner> rough_corners(const CalibrationBoard& board, const std::vector<Marker>& markers,
                                       const PlacedMarkers& placed) {
  const std::vector<Vector3> points = board.points_mm();
  // Each point from the marker that is nearest to it: with ChArUco one of the four around, else the tag's own
  // corner.
  std::map<int, std::pair<double, RoughCorner>> corners;
  const double reach = board.kind == BoardKind::kCharuco
                           ? std::sqrt(0.5) * (board.square_mm - board.marker_mm) * 1.05 + 1e-6
                           : 1e-6 * board.square_mm;
  for (const std::size_t u : placed.used) {
    const auto place = place_of(board, markers[u].id, placed.layout);
    std::vector<cv::Point2d> from, to;
    for (std::size_t k = 0; k < 4; ++k) {
      from.emplace_back((*place)[k].x(), (*place)[k].y());
      to.emplace_back(markers[u].px[k].x(), markers[u].px[k].y());
    }
    bool good = false;
    const Matrix3 h = homography(from, to, &good);
    if (!good) continue;
    const auto at = [&](double x, double y) -> Vector2 { return (h * Vector3(x, y, 1)).hnormalized(); };
    for (std::size_t i = 0; i < points.size(); ++i)
      for (const Vector2& corner : *place) {
        const double away = (corner - points[i].head<2>()).norm();
        const int id = static_cast<int>(i);
        const auto known = corners.find(id);
        if (away > reach || (known != corners.end() && known->second.first <= away)) continue;
        const double x = points[i].x(), y = points[i].y(), e = 0.02 * board.square_mm;
        corners[id] = {
            away,
            {id, at(x, y), (at(x + e, y) - at(x - e, y)) / (2 * e), (at(x, y + e) - at(x, y - e)) / (2 * e)}};
      }
  }
  std::vector<RoughCorner> out;
  for (const auto& [id, c] : corners) out.push_back(c.second);
  return out;
}

double clear_radius_mm(const CalibrationBoard& board) {
  switch (board.kind) {
    case BoardKind::kChessboard:
      return board.square_mm;
    case BoardKind::kCharuco:
      return std::sqrt(0.5) * (board.square_mm - board.marker_mm);
    case BoardKind::kAprilGrid:
      break;
  }
  const double cell = board.square_mm / (6 + 2 * board.border_cells);
  return std::min(std::sqrt(2.0) * board.border_cells * cell, board.gap * board.square_mm);
}

}  // namespace gnathion::board
