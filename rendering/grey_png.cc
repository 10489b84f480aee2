#include "rendering/grey_png.h"

#include <cairo.h>

#include <memory>

namespace gnathion {
namespace {

cairo_status_t append(void* to, const unsigned char* data, unsigned int length) {
  static_cast<std::string*>(to)->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

struct SurfaceDeleter {
  void operator()(cairo_surface_t* s) const { cairo_surface_destroy(s); }
};

}  // namespace

Result<std::string> png_bytes(const Image8& image) {
  const std::unique_ptr<cairo_surface_t, SurfaceDeleter> surface(
      cairo_image_surface_create(CAIRO_FORMAT_RGB24, image.width_px, image.height_px));
  unsigned char* rows = cairo_image_surface_get_data(surface.get());
  const int stride = cairo_image_surface_get_stride(surface.get());
  if (rows != nullptr) {
    for (int y = 0; y < image.height_px; ++y) {
      auto* row = reinterpret_cast<std::uint32_t*>(rows + static_cast<std::ptrdiff_t>(y) * stride);
      for (int x = 0; x < image.width_px; ++x) row[x] = image.at(x, y) * 0x010101u;
    }
    cairo_surface_mark_dirty(surface.get());
  }
  std::string bytes;
  const cairo_status_t status = cairo_surface_write_to_png_stream(surface.get(), append, &bytes);
  if (status != CAIRO_STATUS_SUCCESS)
    return fail(ErrorCode::kInternal, "cannot draw", "PNG", cairo_status_to_string(status));
  return bytes;
}

}  // namespace gnathion
