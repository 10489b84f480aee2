// Drawings as PDF and PNG, and the measure of text: cairo with its own font interface.
#include <cairo-pdf.h>
#include <cairo.h>

#include <cmath>
#include <memory>
#include <mutex>
#include <numbers>

#include "core/file.h"
#include "core/xml.h"
#include "rendering/drawing.h"
#include "rendering/pixels.h"

namespace gnathion {
namespace {

/// Contexts of several threads share fonts, and not all that FreeType does with those is guarded.
std::recursive_mutex& fonts() {
  static std::recursive_mutex mutex;
  return mutex;
}

struct SurfaceDeleter {
  void operator()(cairo_surface_t* s) const { cairo_surface_destroy(s); }
};
struct ContextDeleter {
  void operator()(cairo_t* c) const { cairo_destroy(c); }
};
using Surface = std::unique_ptr<cairo_surface_t, SurfaceDeleter>;
using Context = std::unique_ptr<cairo_t, ContextDeleter>;

void choose_font(cairo_t* cr, double size_pt, bool bold) {
  cairo_select_font_face(cr, "DejaVu Sans", CAIRO_FONT_SLANT_NORMAL,
                         bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(cr, size_pt);
}

cairo_status_t append(void* to, const unsigned char* data, unsigned int length) {
  static_cast<std::string*>(to)->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

struct Bytes {
  const std::string* from;
  std::size_t at = 0;
};
cairo_status_t take(void* source, unsigned char* data, unsigned int length) {
  auto& bytes = *static_cast<Bytes*>(source);
  if (bytes.from->size() - bytes.at < length) return CAIRO_STATUS_READ_ERROR;
  std::copy_n(bytes.from->data() + bytes.at, length, reinterpret_cast<char*>(data));
  bytes.at += length;
  return CAIRO_STATUS_SUCCESS;
}

class Painter {
 public:
  explicit Painter(cairo_t* context) : cr_(context) {}

  void draw(const Drawing& drawing) {
    for (const Drawing::Item& item : drawing.items()) std::visit(*this, item);
  }
  void operator()(const Drawing::Path& p) {
    if (p.points.size() < 2) return;
    cairo_new_path(cr_);
    for (const Point2& at : p.points) cairo_line_to(cr_, at.x(), at.y());
    if (p.closed) cairo_close_path(cr_);
    paint(p.paint);
  }
  void operator()(const Drawing::Circle& c) {
    cairo_new_path(cr_);
    cairo_arc(cr_, c.centre.x(), c.centre.y(), c.radius_pt, 0, 2 * std::numbers::pi);
    cairo_close_path(cr_);
    paint(c.paint);
  }
  void operator()(const Drawing::Text& t) {
    cairo_save(cr_);
    choose_font(cr_, t.style.size_pt, t.style.bold);
    cairo_set_source_rgb(cr_, t.style.color[0], t.style.color[1], t.style.color[2]);
    cairo_translate(cr_, t.at.x(), t.at.y());
    cairo_rotate(cr_, t.style.turn_deg * std::numbers::pi / 180);
    const double width = text_width_pt(t.text, t.style.size_pt, t.style.bold);
    cairo_move_to(cr_, -width * 0.5 * static_cast<int>(t.style.anchor), 0);
    cairo_show_text(cr_, t.text.c_str());
    cairo_restore(cr_);
  }
  void operator()(const Drawing::Image& i) {
    Bytes bytes{&i.png};
    const Surface image(cairo_image_surface_create_from_png_stream(take, &bytes));
    if (cairo_surface_status(image.get()) != CAIRO_STATUS_SUCCESS) return;
    if (!i.jpeg.empty()) {  // PDF takes the bytes as they are; other surfaces ignore them
      auto* copy = new std::string(i.jpeg);
      const auto drop = [](void* held) { delete static_cast<std::string*>(held); };
      if (cairo_surface_set_mime_data(image.get(), CAIRO_MIME_TYPE_JPEG,
                                      reinterpret_cast<const unsigned char*>(copy->data()), copy->size(),
                                      drop, copy) != CAIRO_STATUS_SUCCESS)
        delete copy;
    }
    cairo_save(cr_);
    cairo_translate(cr_, i.corner.x(), i.corner.y());
    cairo_scale(cr_, i.size.x() / cairo_image_surface_get_width(image.get()),
                i.size.y() / cairo_image_surface_get_height(image.get()));
    cairo_set_source_surface(cr_, image.get(), 0, 0);
    cairo_pattern_set_filter(cairo_get_source(cr_), CAIRO_FILTER_GOOD);
    cairo_paint(cr_);
    cairo_restore(cr_);
  }
  void operator()(const Drawing::Placed& p) {
    cairo_save(cr_);
    cairo_translate(cr_, p.corner.x(), p.corner.y());
    cairo_scale(cr_, p.scale, p.scale);
    draw(*p.drawing);
    cairo_restore(cr_);
  }

 private:
  void paint(const Paint& p) {
    const auto source = [&](const Color& c) { cairo_set_source_rgba(cr_, c[0], c[1], c[2], p.opacity); };
    if (p.fill) {
      source(*p.fill);
      cairo_fill_preserve(cr_);
    }
    if (p.width_pt > 0) {
      source(p.stroke);
      cairo_set_line_width(cr_, p.width_pt);
      cairo_set_line_join(cr_, CAIRO_LINE_JOIN_ROUND);
      cairo_set_dash(cr_, p.dash_pt.data(), static_cast<int>(p.dash_pt.size()), 0);
      cairo_stroke_preserve(cr_);
    }
    cairo_new_path(cr_);
  }
  cairo_t* cr_;
};

Status drawn(cairo_status_t status, const std::string& where) {
  if (status == CAIRO_STATUS_SUCCESS) return {};
  return fail(ErrorCode::kInternal, "cannot draw", where, cairo_status_to_string(status));
}

}  // namespace

double text_width_pt(const std::string& text, double size_pt, bool bold) {
  const std::lock_guard lock(fonts());
  static const Surface surface(cairo_image_surface_create(CAIRO_FORMAT_A8, 8, 8));
  static const Context context = [] {
    Context c(cairo_create(surface.get()));
    cairo_font_options_t* options = cairo_font_options_create();
    cairo_font_options_set_hint_metrics(options, CAIRO_HINT_METRICS_OFF);
    cairo_set_font_options(c.get(), options);
    cairo_font_options_destroy(options);
    return c;
  }();
  choose_font(context.get(), 100, bold);  // measured large, so that widths do not snap to pixels
  cairo_text_extents_t extents;
  // One bad byte would leave the context in error, and every later width zero.
  cairo_text_extents(context.get(), valid_utf8(text).c_str(), &extents);
  return extents.x_advance * size_pt / 100;
}

Status paint(const Drawing& drawing, double scale, Pixels& onto) {
  static_assert(sizeof(onto.rgb[0]) == 4);  // as cairo's RGB24
  const std::lock_guard lock(fonts());
  const Surface surface(cairo_image_surface_create_for_data(
      reinterpret_cast<unsigned char*>(onto.rgb.data()), CAIRO_FORMAT_RGB24, onto.width_px, onto.height_px,
      cairo_format_stride_for_width(CAIRO_FORMAT_RGB24, onto.width_px)));
  const Context context(cairo_create(surface.get()));
  cairo_scale(context.get(), scale, scale);
  Painter(context.get()).draw(drawing);
  cairo_surface_flush(surface.get());
  return drawn(cairo_status(context.get()), "PNG");
}

Result<std::string> png_bytes(const Drawing& drawing, double scale) {
  Pixels pixels(static_cast<int>(std::ceil(drawing.width_pt() * scale)),
                static_cast<int>(std::ceil(drawing.height_pt() * scale)));
  GNATHION_CHECK_OK(paint(drawing, scale, pixels));
  return png_bytes(pixels);
}

Status write_pdf(const std::filesystem::path& path, const std::vector<std::shared_ptr<const Drawing>>& pages,
                 const PdfInfo& info) {
  std::string bytes;
  {
    const std::lock_guard lock(fonts());
    const Surface surface(cairo_pdf_surface_create_for_stream(append, &bytes, 595, 842));
    cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_TITLE, info.title.c_str());
    cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_CREATOR, info.creator.c_str());
    // Left alone, cairo writes the time of day and no two files are alike.
    cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_CREATE_DATE,
                                   info.date_iso.empty() ? nullptr : info.date_iso.c_str());
    const Context context(cairo_create(surface.get()));
    for (const auto& page : pages) {
      cairo_pdf_surface_set_size(surface.get(), page->width_pt(), page->height_pt());
      Painter(context.get()).draw(*page);
      cairo_show_page(context.get());
    }
    GNATHION_CHECK_OK(drawn(cairo_status(context.get()), path.string()));
    cairo_surface_finish(surface.get());
    GNATHION_CHECK_OK(drawn(cairo_surface_status(surface.get()), path.string()));
  }
  return write_file(path, bytes);
}

}  // namespace gnathion
