// The printed pattern of one AprilTag, module by module.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/result.h"

namespace gnathion {

/// Square grid of modules, row 0 on top as printed. The outermost ring is the white border.
struct TagImage {
  int modules = 0;                  ///< a side, white border included (tag36h11: 10)
  int border_modules = 0;           ///< width of the white ring around the black square (tag36h11: 1)
  std::vector<std::uint8_t> white;  ///< row-major, 1 = white

  /// Side of the black square in modules: what a tag's nominal size measures.
  int square_modules() const { return modules - 2 * border_modules; }
  /// White outside the pattern too: the tag is printed on white stock.
  bool is_white(int column, int row) const {
    if (column < 0 || row < 0 || column >= modules || row >= modules) return true;
    return white[static_cast<std::size_t>(row * modules + column)] != 0;
  }
};

/// Pattern of tag `id`. Families: tag36h11, tag25h9, tag16h5. Fails (kInput) for another family or
/// an id that the family does not have.
Result<TagImage> tag_image(const std::string& family, int id);

}  // namespace gnathion
