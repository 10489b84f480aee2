#include "rendering/plot.h"

#include <algorithm>

#include "core/file.h"
#include "rendering/chart_axes.h"
#include "rendering/pixels.h"

namespace gnathion {
namespace {

constexpr double kPixelsPerPoint = 2.0;
constexpr int kTicks = 12;
/// Room around the axes: left, top, right, bottom, pt.
constexpr double kMargin_pt[4] = {46, 28, 14, 36};

struct Ranges {
  Eigen::Vector2d x{0, 0}, y{0, 0};
};

void fit(Eigen::Vector2d& range, const std::vector<PlotCurve>& curves, int axis) {
  if (range[0] < range[1]) return;
  double low = 1e300, high = -1e300;
  for (const PlotCurve& c : curves)
    for (const Polyline2& line : c.lines)
      for (const Eigen::Vector2d& p : line) {
        low = std::min(low, p[axis]);
        high = std::max(high, p[axis]);
      }
  if (low > high) low = 0, high = 1;
  const double margin = std::max(1e-6, 0.05 * (high - low));
  range = {low - margin, high + margin};
}

/// Widens the range that has room to spare until a millimetre is the same both ways.
void equalise(Ranges& r, const Point2& size) {
  const double per_pt = std::max((r.x[1] - r.x[0]) / size.x(), (r.y[1] - r.y[0]) / size.y());
  const auto widen = [&](Eigen::Vector2d& range, double length) {
    const double centre = 0.5 * (range[0] + range[1]), half = 0.5 * per_pt * length;
    range = {centre - half, centre + half};
  };
  widen(r.x, size.x());
  widen(r.y, size.y());
}

void add_curves(Drawing& d, const PlotArea& area, const std::vector<PlotCurve>& curves) {
  const Point2 low(area.x_low, area.y_low), high(area.x_high, area.y_high);
  for (const PlotCurve& curve : curves)
    for (const Polyline2& line : curve.lines)
      for (const Polyline2& piece : clipped(line, low, high)) {
        std::vector<Point2> points;
        for (const Point2& p : piece) points.push_back(area.at(p.x(), p.y()));
        d.path(std::move(points), false, stroked(curve.color, curve.width_px / kPixelsPerPoint));
      }
}

/// In the upper right corner, one line for each name.
void add_legend(Drawing& d, const PlotArea& area, const std::vector<PlotCurve>& curves) {
  constexpr double kLine = 13, kSample = 30, kPad = 6, kSize = 8;
  std::vector<LegendEntry> entries;
  double width = 0;
  for (const PlotCurve& curve : curves) {
    const auto known = [&](const LegendEntry& e) { return e.name == curve.name; };
    if (std::any_of(entries.begin(), entries.end(), known)) continue;
    entries.push_back({curve.name, stroked(curve.color, curve.width_px / kPixelsPerPoint)});
    width = std::max(width, text_width_pt(curve.name, kSize) + kSample);
  }
  if (entries.empty()) return;
  const Point2 size(width + 2 * kPad, kLine * static_cast<double>(entries.size()) + kPad);
  const Point2 corner(area.corner.x() + area.size.x() - size.x() - 4, area.corner.y() + 4);
  Paint box = filled({1, 1, 1}, 0.9);
  box.stroke = kMuted;
  box.width_pt = 0.6;
  d.rectangle(corner, size, box);
  for (std::size_t i = 0; i < entries.size(); ++i)
    draw_legend(&d, corner + Point2(kPad, 0.5 * kPad + kLine * static_cast<double>(i)), size.x(),
                {entries[i]});
}

}  // namespace

Status plot_curves(const std::filesystem::path& png, const std::vector<PlotCurve>& curves,
                   const PlotOptions& options) {
  Drawing d(options.width_px / kPixelsPerPoint, options.height_px / kPixelsPerPoint);
  const Point2 size(d.width_pt() - kMargin_pt[0] - kMargin_pt[2],
                    d.height_pt() - kMargin_pt[1] - kMargin_pt[3]);
  Ranges ranges{options.x_range, options.y_range};
  fit(ranges.x, curves, 0);
  fit(ranges.y, curves, 1);
  if (options.equal_axes) equalise(ranges, size);
  const PlotArea area{
      {kMargin_pt[0], kMargin_pt[1]}, size, ranges.x[0], ranges.x[1], ranges.y[0], ranges.y[1]};
  TextStyle title;
  title.size_pt = 12;
  title.anchor = Anchor::kMiddle;
  d.text({0.5 * d.width_pt(), 18}, text_fitted(options.title, d.width_pt() - 16, title.size_pt), title);
  draw_x_axis(d, area, kTicks, options.x_label, 8.5);
  draw_y_axis(d, area, kTicks, options.y_label, 8.5);
  add_curves(d, area, curves);
  draw_frame(d, area);
  add_legend(d, area, curves);
  GNATHION_TRY(const std::string bytes, png_bytes(d, kPixelsPerPoint));
  return write_file(png, bytes);
}

}  // namespace gnathion
