#include "core/calibration_board.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>

namespace gnathion {
namespace {

constexpr int kMostColumns = 100;

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == ':')
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

bool read_number(const std::string& text, double* value) {
  char* end = nullptr;
  *value = std::strtod(text.c_str(), &end);
  return end != text.c_str() && *end == 0 && std::isfinite(*value);
}

bool read_count(const std::string& text, int* value) {
  if (text.empty() || text.size() > 4 || text.find_first_not_of("0123456789") != std::string::npos)
    return false;
  *value = std::atoi(text.c_str());
  return true;
}

bool read_size(const std::string& text, int* columns, int* rows) {
  const auto x = text.find('x');
  return x != std::string::npos && read_count(text.substr(0, x), columns) &&
         read_count(text.substr(x + 1), rows) && *columns <= kMostColumns && *rows <= kMostColumns;
}

tl::unexpected<Error> refuse(const std::string& text, const std::string& why) {
  return fail(ErrorCode::kUsage, "cannot read board", text,
              why +
                  "; a board is chessboard:COLUMNSxROWS:SQUARE_MM (inner corners), "
                  "charuco:COLUMNSxROWS:SQUARE_MM:MARKER_MM:DICTIONARY (squares; 4X4_50, 5X5_100, …) or "
                  "aprilgrid:COLUMNSxROWS:TAG_MM:GAP (tags; gap over tag side)[:tag36h11[:BORDER_CELLS]]");
}

}  // namespace

std::string CalibrationBoard::text() const {
  switch (kind) {
    case BoardKind::kChessboard:
      return fmt::format("chessboard:{}x{}:{}", columns, rows, square_mm);
    case BoardKind::kCharuco:
      return fmt::format("charuco:{}x{}:{}:{}:{}", columns, rows, square_mm, marker_mm, family);
    case BoardKind::kAprilGrid:
      break;
  }
  return fmt::format("aprilgrid:{}x{}:{}:{}:{}{}", columns, rows, square_mm, gap, family,
                     border_cells == 1 ? std::string() : fmt::format(":{}", border_cells));
}

std::vector<Vector3> CalibrationBoard::points_mm() const {
  std::vector<Vector3> points;
  if (kind == BoardKind::kAprilGrid) {
    const double pitch = square_mm * (1 + gap), s = square_mm;
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < columns; ++c) {
        const Vector3 lower_left(c * pitch, -r * pitch, 0);
        for (const Vector3& d : {Vector3(0, 0, 0), Vector3(s, 0, 0), Vector3(s, -s, 0), Vector3(0, -s, 0)})
          points.push_back(lower_left + d);
      }
    return points;
  }
  const int inner = kind == BoardKind::kCharuco ? 1 : 0;
  for (int r = 0; r < rows - inner; ++r)
    for (int c = 0; c < columns - inner; ++c) points.emplace_back(c * square_mm, r * square_mm, 0);
  return points;
}

bool CalibrationBoard::turns_unseen() const {
  return kind == BoardKind::kChessboard && (columns + rows) % 2 == 0;
}

Result<CalibrationBoard> parse_board(const std::string& text) {
  const std::vector<std::string> parts = split(text);
  CalibrationBoard b;
  const bool chess = parts[0] == "chessboard", charuco = parts[0] == "charuco",
             grid = parts[0] == "aprilgrid";
  if (!chess && !charuco && !grid) return refuse(text, "unknown kind '" + parts[0] + "'");
  b.kind = chess ? BoardKind::kChessboard : charuco ? BoardKind::kCharuco : BoardKind::kAprilGrid;
  const std::size_t least = chess ? 3 : charuco ? 5 : 4, most = grid ? 6 : least;
  if (parts.size() < least || parts.size() > most)
    return refuse(text, fmt::format("{} parts, {} expected", parts.size(), least));
  if (!read_size(parts[1], &b.columns, &b.rows))
    return refuse(text, "'" + parts[1] + "' is not COLUMNSxROWS");
  const int least_columns = chess || charuco ? 3 : 2;
  if (b.columns < least_columns || b.rows < least_columns)
    return refuse(text, fmt::format("at least {0}x{0} are needed", least_columns));
  if (!read_number(parts[2], &b.square_mm) || b.square_mm < 0.5 || b.square_mm > 500)
    return refuse(text, "'" + parts[2] + "' is not a length of 0.5 to 500 mm");
  if (charuco) {
    if (!read_number(parts[3], &b.marker_mm) || b.marker_mm < 0.3 * b.square_mm ||
        b.marker_mm > 0.95 * b.square_mm)
      return refuse(text, "the marker must be 0.3 to 0.95 of the square");
    b.family = parts[4].rfind("DICT_", 0) == 0 ? parts[4].substr(5) : parts[4];
  }
  if (grid) {
    if (!read_number(parts[3], &b.gap) || b.gap < 0.05 || b.gap > 1)
      return refuse(text, "the gap is given over the tag's side, 0.05 to 1");
    b.family = parts.size() > 4 ? parts[4] : "tag36h11";
    if (b.family != "tag36h11") return refuse(text, "tag family '" + b.family + "' is not supported");
    if (parts.size() > 5 &&
        (!read_count(parts[5], &b.border_cells) || b.border_cells < 1 || b.border_cells > 2))
      return refuse(text, "a border is 1 or 2 cells wide");
    if (b.columns * b.rows > 587) return refuse(text, "tag36h11 has 587 tags");
  }
  return b;
}

}  // namespace gnathion
