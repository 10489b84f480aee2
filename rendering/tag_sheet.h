// Sheets of tags to print, cut out and glue: A4 at true scale, with a ruler to check the printer.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "rendering/drawing.h"

namespace gnathion {

/// The cells of one tag: the black square is `square_cells` wide, row-major from the upper left.
struct SheetTag {
  int id = 0;
  int square_cells = 0;
  std::vector<std::uint8_t> white;
};

inline constexpr double kPointsPerMm = 72.0 / 25.4;

/// Pages with as many stickers as fit. The sticker is the black square (side_mm) with one white cell about
/// it; cut marks stand at its corners, id and body outside.
std::vector<std::shared_ptr<const Drawing>> tag_sheets(const std::vector<SheetTag>& tags, double side_mm,
                                                       const std::string& body);

/// Where a tag is glued, seen from the front: its corners (lower left, lower right, upper right, upper left),
/// mm, x to the right and y up.
struct PlacedTag {
  int id = 0;
  std::vector<Point2> corners_mm;
};
/// One page with the bodies drawn one under the other.
std::shared_ptr<const Drawing> tag_placement_page(
    const std::vector<std::pair<std::string, std::vector<PlacedTag>>>& bodies);

}  // namespace gnathion
