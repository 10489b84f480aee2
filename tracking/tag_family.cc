#include "tracking/tag_family.h"

#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h11.h>

#include "core/check.h"

namespace gnathion {
namespace {

std::vector<std::uint8_t> cells_of(const apriltag_family_t& family, std::uint64_t code) {
  const int n = family.width_at_border;
  std::vector<std::uint8_t> white(static_cast<std::size_t>(n * n), 0);
  for (std::uint32_t bit = 0; bit < family.nbits; ++bit) {
    const std::uint64_t mask = std::uint64_t{1} << (family.nbits - bit - 1);
    const std::size_t cell = family.bit_y[bit] * static_cast<std::size_t>(n) + family.bit_x[bit];
    white[cell] = (code & mask) ? 1 : 0;
  }
  return white;
}

}  // namespace

Result<TagFamily> TagFamily::load(const std::string& name) {
  apriltag_family_t* family = nullptr;
  void (*destroy)(apriltag_family_t*) = nullptr;
  if (name == "tag36h11") {
    family = tag36h11_create();
    destroy = tag36h11_destroy;
  } else if (name == "tag25h9") {
    family = tag25h9_create();
    destroy = tag25h9_destroy;
  } else if (name == "tag16h5") {
    family = tag16h5_create();
    destroy = tag16h5_destroy;
  } else {
    return bad_input("cannot use tag family", name, "known are tag36h11, tag25h9 and tag16h5");
  }
  TagFamily result;
  result.name_ = name;
  result.square_cells_ = family->width_at_border;
  for (std::uint32_t id = 0; id < family->ncodes; ++id) {
    result.white_.push_back(cells_of(*family, family->codes[id]));
  }
  destroy(family);
  return result;
}

bool TagFamily::white(int id, int cell_x, int cell_y) const {
  GNATHION_CHECK(id >= 0 && id < count());
  if (cell_x < 0 || cell_y < 0 || cell_x >= square_cells_ || cell_y >= square_cells_) return true;
  return white_[static_cast<std::size_t>(id)][static_cast<std::size_t>(cell_y * square_cells_ + cell_x)] != 0;
}

}  // namespace gnathion
