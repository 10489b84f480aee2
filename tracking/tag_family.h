// What a tag looks like: the bit patterns of a family, taken from libapriltag.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "core/result.h"

namespace gnathion {

/// The cells of a family's tags. Cells are counted from the upper left one of the black square, x right and
/// y down; the black square is `square_cells` wide, with its border one cell; one white cell lies around it.
class TagFamily {
 public:
  /// "tag36h11", "tag25h9" or "tag16h5" (the families with a black border and square data area).
  static Result<TagFamily> load(const std::string& name);

  const std::string& name() const { return name_; }
  int count() const { return static_cast<int>(white_.size()); }
  int square_cells() const { return square_cells_; }
  /// Whether a cell is white; the border is black, everything outside of the square white.
  bool white(int id, int cell_x, int cell_y) const;

 private:
  std::string name_;
  int square_cells_ = 0;
  std::vector<std::vector<std::uint8_t>> white_;  ///< per id, row-major over the black square
};

}  // namespace gnathion
