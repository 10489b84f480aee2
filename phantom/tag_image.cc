#include "phantom/tag_image.h"

#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h11.h>

#include <cstdlib>
#include <memory>

namespace gnathion {
namespace {

using Family = std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)>;

Family open_family(const std::string& name) {
  if (name == "tag36h11") return {tag36h11_create(), tag36h11_destroy};
  if (name == "tag25h9") return {tag25h9_create(), tag25h9_destroy};
  if (name == "tag16h5") return {tag16h5_create(), tag16h5_destroy};
  return {nullptr, [](apriltag_family_t*) {}};
}

/// What upstream's image_u8_destroy does; Debian's library does not export it.
void free_image(image_u8_t* image) {
  std::free(image->buf);
  std::free(image);
}

}  // namespace

Result<TagImage> tag_image(const std::string& family_name, int id) {
  const Family family = open_family(family_name);
  if (!family) return bad_input("cannot draw tag", family_name, "unknown tag family");
  if (id < 0 || static_cast<std::uint32_t>(id) >= family->ncodes)
    return bad_input("cannot draw tag", family_name, "the family has no tag " + std::to_string(id));
  const std::unique_ptr<image_u8_t, void (*)(image_u8_t*)> drawn(
      apriltag_to_image(family.get(), static_cast<std::uint32_t>(id)), free_image);

  TagImage tag;
  tag.modules = family->total_width;
  tag.border_modules = (family->total_width - family->width_at_border) / 2;
  for (int row = 0; row < tag.modules; ++row)
    for (int column = 0; column < tag.modules; ++column)
      tag.white.push_back(drawn->buf[row * drawn->stride + column] > 127 ? 1 : 0);
  return tag;
}

}  // namespace gnathion
