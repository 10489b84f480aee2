#include "rendering/pixels.h"

#include <png.h>

namespace gnathion {
namespace {

constexpr int kCompression = 2;  // of 9; pictures of shaded surfaces hardly gain by more

void append(png_structp png, png_bytep data, std::size_t length) {
  static_cast<std::string*>(png_get_io_ptr(png))->append(reinterpret_cast<const char*>(data), length);
}
void flush(png_structp) {}

/// Writes row after row; false where libpng gives up. Holds no object that a long jump would skip.
bool write_rows(png_structp png, png_infop info, const Pixels& pixels, std::uint8_t* row) {
  if (setjmp(png_jmpbuf(png))) return false;
  const auto width = static_cast<std::size_t>(pixels.width_px);
  png_set_IHDR(png, info, static_cast<png_uint_32>(pixels.width_px),
               static_cast<png_uint_32>(pixels.height_px), 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_compression_level(png, kCompression);
  png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
  png_write_info(png, info);
  for (int y = 0; y < pixels.height_px; ++y) {
    const std::uint32_t* from = pixels.rgb.data() + static_cast<std::size_t>(y) * width;
    for (std::size_t x = 0; x < width; ++x) {
      row[3 * x] = static_cast<std::uint8_t>(from[x] >> 16);
      row[3 * x + 1] = static_cast<std::uint8_t>(from[x] >> 8);
      row[3 * x + 2] = static_cast<std::uint8_t>(from[x]);
    }
    png_write_row(png, row);
  }
  png_write_end(png, info);
  return true;
}

}  // namespace

Result<std::string> png_bytes(const Pixels& pixels) {
  std::string bytes;
  std::vector<std::uint8_t> row(3 * static_cast<std::size_t>(pixels.width_px));
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  bool written = false;
  if (info) {
    png_set_write_fn(png, &bytes, append, flush);
    written = write_rows(png, info, pixels, row.data());
  }
  png_destroy_write_struct(&png, &info);
  if (!written) return fail(ErrorCode::kInternal, "cannot draw", "PNG", "libpng gave up");
  return bytes;
}

}  // namespace gnathion
