#include "rendering/drawing.h"

#include <fmt/format.h>

#include <cmath>

#include "core/file.h"
#include "core/xml.h"

namespace gnathion {
namespace {

/// Shortest text of a coordinate to 1/100 point.
std::string number(double value) {
  std::string text = fmt::format("{:.2f}", std::abs(value) < 0.005 ? 0.0 : value);
  while (text.back() == '0') text.pop_back();
  if (text.back() == '.') text.pop_back();
  return text;
}

std::string hex(const Color& c) {
  const auto byte = [](double v) {
    return static_cast<int>(std::lround(255 * std::fmin(1, std::fmax(0, v))));
  };
  return fmt::format("#{:02x}{:02x}{:02x}", byte(c[0]), byte(c[1]), byte(c[2]));
}

std::string attributes(const Paint& p) {
  std::string text = p.fill ? fmt::format(" fill=\"{}\"", hex(*p.fill)) : " fill=\"none\"";
  if (p.width_pt > 0) {
    text += fmt::format(" stroke=\"{}\" stroke-width=\"{}\"", hex(p.stroke), number(p.width_pt));
    text += " stroke-linejoin=\"round\"";
    if (!p.dash_pt.empty()) {
      std::string dash;
      for (const double d : p.dash_pt) dash += (dash.empty() ? "" : ",") + number(d);
      text += fmt::format(" stroke-dasharray=\"{}\"", dash);
    }
  }
  if (p.opacity < 1) text += fmt::format(" opacity=\"{}\"", number(p.opacity));
  return text;
}

class SvgBody {
 public:
  void add(const Drawing& drawing) {
    for (const Drawing::Item& item : drawing.items()) std::visit(*this, item);
  }
  void operator()(const Drawing::Path& p) {
    if (p.points.size() < 2) return;
    svg += p.closed ? "<polygon points=\"" : "<polyline points=\"";
    for (std::size_t i = 0; i < p.points.size(); ++i)
      svg += (i ? " " : "") + number(p.points[i].x()) + "," + number(p.points[i].y());
    svg += "\"" + attributes(p.paint) + "/>\n";
  }
  void operator()(const Drawing::Circle& c) {
    svg += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"{}\"{}/>\n", number(c.centre.x()),
                       number(c.centre.y()), number(c.radius_pt), attributes(c.paint));
  }
  void operator()(const Drawing::Text& t) {
    static const char* const anchors[] = {"start", "middle", "end"};
    const double width = text_width_pt(t.text, t.style.size_pt, t.style.bold);
    std::string more;
    if (t.style.bold) more += " font-weight=\"bold\"";
    if (t.style.turn_deg != 0)
      more += fmt::format(" transform=\"rotate({} {} {})\"", number(t.style.turn_deg), number(t.at.x()),
                          number(t.at.y()));
    if (t.text.size() > 3)
      more += fmt::format(" textLength=\"{}\" lengthAdjust=\"spacingAndGlyphs\"", number(width));
    svg +=
        fmt::format("<text x=\"{}\" y=\"{}\" font-size=\"{}\" text-anchor=\"{}\" fill=\"{}\"{}>{}</text>\n",
                    number(t.at.x()), number(t.at.y()), number(t.style.size_pt),
                    anchors[static_cast<int>(t.style.anchor)], hex(t.style.color), more, xml_escaped(t.text));
  }
  void operator()(const Drawing::Image& i) {
    svg += fmt::format(
        "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" "
        "href=\"data:image/{};base64,{}\"/>\n",
        number(i.corner.x()), number(i.corner.y()), number(i.size.x()), number(i.size.y()),
        i.jpeg.empty() ? "png" : "jpeg", base64(i.jpeg.empty() ? i.png : i.jpeg));
  }
  void operator()(const Drawing::Placed& p) {
    svg += fmt::format("<g transform=\"translate({} {}) scale({:.5g})\">\n", number(p.corner.x()),
                       number(p.corner.y()), p.scale);
    add(*p.drawing);
    svg += "</g>\n";
  }
  std::string svg;
};

}  // namespace

Paint stroked(const Color& color, double width_pt, std::vector<double> dash_pt) {
  Paint p;
  p.stroke = color;
  p.width_pt = width_pt;
  p.dash_pt = std::move(dash_pt);
  return p;
}

Paint filled(const Color& color, double opacity) {
  Paint p;
  p.width_pt = 0;
  p.fill = color;
  p.opacity = opacity;
  return p;
}

void Drawing::path(std::vector<Point2> points, bool closed, const Paint& paint) {
  items_.emplace_back(std::in_place_type<Path>, Path{std::move(points), closed, paint});
}
void Drawing::rectangle(const Point2& corner, const Point2& size, const Paint& paint) {
  const Point2 right(size.x(), 0), down(0, size.y());
  path({corner, corner + right, corner + size, corner + down}, true, paint);
}
void Drawing::circle(const Point2& centre, double radius_pt, const Paint& paint) {
  items_.emplace_back(std::in_place_type<Circle>, Circle{centre, radius_pt, paint});
}
void Drawing::text(const Point2& at, std::string text, const TextStyle& style) {
  if (!text.empty()) items_.emplace_back(std::in_place_type<Text>, Text{at, valid_utf8(text), style});
}
void Drawing::image(const Point2& corner, const Point2& size, std::string png, std::string jpeg) {
  items_.emplace_back(std::in_place_type<Image>, Image{corner, size, std::move(png), std::move(jpeg)});
}
void Drawing::place(std::shared_ptr<const Drawing> child, const Point2& corner, double scale) {
  items_.emplace_back(std::in_place_type<Placed>, Placed{std::move(child), corner, scale});
}

std::string svg_text(const Drawing& drawing, const std::string& description) {
  SvgBody body;
  body.add(drawing);
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}pt\" height=\"{1}pt\" viewBox=\"0 0 {0} {1}\" "
      "font-family=\"'DejaVu Sans',Verdana,sans-serif\" role=\"img\" aria-label=\"{2}\">\n<rect "
      "width=\"{0}\" height=\"{1}\" fill=\"#fff\"/>\n{3}</svg>\n",
      number(drawing.width_pt()), number(drawing.height_pt()), xml_escaped(description), body.svg);
}

Status write_svg(const std::filesystem::path& path, const Drawing& drawing, const std::string& description) {
  return write_file(path, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n" + svg_text(drawing, description));
}

}  // namespace gnathion
