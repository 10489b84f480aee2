// A page or figure as a list of vector shapes, and what can be made of it: SVG, PDF, PNG.
//
// Lengths are points (1/72 inch), x to the right, y downwards. Text is measured with the font that PDF and
// PNG are set in (DejaVu Sans); SVG carries each text's measured length, so that another font does not
// overlap.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "core/result.h"
#include "rendering/scene.h"

namespace gnathion {

using Point2 = Eigen::Vector2d;

/// How a shape is stroked and filled; width 0 means no stroke.
struct Paint {
  Color stroke = {0, 0, 0};
  double width_pt = 0.8;
  std::vector<double> dash_pt;  ///< lengths of stroke and gap in turn; empty: solid
  std::optional<Color> fill;
  double opacity = 1.0;  ///< of stroke and fill
};
Paint stroked(const Color& color, double width_pt = 0.8, std::vector<double> dash_pt = {});
Paint filled(const Color& color, double opacity = 1.0);

enum class Anchor { kStart, kMiddle, kEnd };
struct TextStyle {
  double size_pt = 9;
  Color color = {0.11, 0.14, 0.19};
  Anchor anchor = Anchor::kStart;
  bool bold = false;
  double turn_deg = 0;  ///< about the anchor point; −90 reads upwards
};

class Drawing {
 public:
  Drawing(double width_pt, double height_pt) : width_pt_(width_pt), height_pt_(height_pt) {}
  double width_pt() const { return width_pt_; }
  double height_pt() const { return height_pt_; }

  void line(const Point2& a, const Point2& b, const Paint& paint) { path({a, b}, false, paint); }
  void path(std::vector<Point2> points, bool closed, const Paint& paint);
  void rectangle(const Point2& corner, const Point2& size, const Paint& paint);
  void circle(const Point2& centre, double radius_pt, const Paint& paint);
  /// `at` is on the base line.
  void text(const Point2& at, std::string text, const TextStyle& style);
  /// PNG bytes, stretched into the rectangle. With `jpeg` of the same picture, SVG and PDF carry that
  /// instead.
  void image(const Point2& corner, const Point2& size, std::string png, std::string jpeg = {});
  /// Another drawing, its top left corner at `corner`, scaled.
  void place(std::shared_ptr<const Drawing> child, const Point2& corner, double scale = 1.0);

  struct Path {
    std::vector<Point2> points;
    bool closed;
    Paint paint;
  };
  struct Circle {
    Point2 centre;
    double radius_pt;
    Paint paint;
  };
  struct Text {
    Point2 at;
    std::string text;
    TextStyle style;
  };
  struct Image {
    Point2 corner, size;
    std::string png, jpeg;
  };
  struct Placed {
    std::shared_ptr<const Drawing> drawing;
    Point2 corner;
    double scale;
  };
  using Item = std::variant<Path, Circle, Text, Image, Placed>;
  const std::vector<Item>& items() const { return items_; }

 private:
  double width_pt_, height_pt_;
  std::vector<Item> items_;
};

/// Width of a text as it will be set. Thread-safe.
double text_width_pt(const std::string& text, double size_pt, bool bold = false);
/// The text, or its beginning with an ellipsis, no wider than asked.
std::string text_fitted(const std::string& text, double width_pt, double size_pt, bool bold = false);
/// The text broken at spaces (and inside words that are too long) into lines no wider than asked.
std::vector<std::string> text_wrapped(const std::string& text, double width_pt, double size_pt,
                                      bool bold = false);

/// One <svg> element without an XML declaration, to stand alone or inside HTML; `description` is its
/// accessible name.
std::string svg_text(const Drawing& drawing, const std::string& description);
/// `scale`: pixels per point.
Result<std::string> png_bytes(const Drawing& drawing, double scale = 2.0);
/// SVG (whole or not at all).
Status write_svg(const std::filesystem::path& path, const Drawing& drawing, const std::string& description);

struct PdfInfo {
  std::string title, creator;
  std::string date_iso;  ///< "2026-01-31T12:00:00Z" in the document's properties; empty: none
};
/// One page for each drawing. Text stays text; the same pages give the same bytes.
Status write_pdf(const std::filesystem::path& path, const std::vector<std::shared_ptr<const Drawing>>& pages,
                 const PdfInfo& info);

}  // namespace gnathion
