#include <algorithm>
#include <cmath>
#include <numbers>

#include "rendering/chart_axes.h"

namespace gnathion {
namespace {

struct Rose {
  Point2 centre;
  double radius_pt, low, high;
  std::size_t spokes;
  double turn(std::size_t spoke) const {
    return 2 * std::numbers::pi * static_cast<double>(spoke) / static_cast<double>(spokes);
  }
  Point2 direction(double turn_rad) const { return {std::sin(turn_rad), -std::cos(turn_rad)}; }
  double reach(double value) const { return radius_pt * (value - low) / (high - low); }
  Point2 at(std::size_t spoke, double value) const { return centre + reach(value) * direction(turn(spoke)); }
};

void draw_rings(Drawing& to, const Rose& rose, const std::string& unit) {
  const std::vector<double> ticks = axis_ticks(rose.low, rose.high, 5);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : 1;
  for (std::size_t s = 0; s < rose.spokes; ++s)
    to.line(rose.centre, rose.centre + rose.radius_pt * rose.direction(rose.turn(s)), stroked(kFaint, 0.6));
  for (const double t : ticks) {
    std::vector<Point2> ring;
    for (std::size_t s = 0; s < rose.spokes; ++s) ring.push_back(rose.at(s, t));
    const bool zero = std::abs(t) < 1e-9 * step && rose.low < 0;
    to.path(ring, true, zero ? stroked(kMuted, 1.0) : stroked(kFaint, 0.6));
  }
  // Values stand between the first two spokes, off every line.
  const double turn = rose.turn(1) / 2;
  const double inward = std::cos(turn);  // rings are polygons: nearer there
  TextStyle style;
  style.size_pt = 7;
  style.color = kMuted;
  style.anchor = Anchor::kMiddle;
  for (const double t : ticks)
    if (rose.reach(t) > 8)
      to.text(rose.centre + inward * rose.reach(t) * rose.direction(turn) + Point2(0, 2.5),
              tick_text(t, step) + (t == ticks.back() ? " " + unit : ""), style);
}

void draw_names(Drawing& to, const Rose& rose, const std::vector<std::string>& axes) {
  TextStyle style;
  style.size_pt = 8.5;
  for (std::size_t s = 0; s < rose.spokes; ++s) {
    const Point2 out = rose.direction(rose.turn(s));
    const Point2 at = rose.centre + (rose.radius_pt + 10) * out;
    style.anchor = std::abs(out.x()) < 0.1 ? Anchor::kMiddle : out.x() > 0 ? Anchor::kStart : Anchor::kEnd;
    const std::vector<std::string> lines = text_wrapped(axes[s], 92, style.size_pt);
    const double height = 11.0 * static_cast<double>(lines.size());
    double y = at.y() + 8 - height * (1 - out.y()) / 2;
    for (const std::string& line : lines) {
      to.text({at.x(), y}, line, style);
      y += 11;
    }
  }
}

}  // namespace

Drawing radar_chart(const std::vector<std::string>& axes, const std::vector<RadarSeries>& series,
                    const std::string& unit, const std::string& title) {
  Drawing d(440, 372);
  Rose rose{{220, 186}, 118, 0, 0, axes.size()};
  for (const RadarSeries& s : series)
    for (const double v : s.values) {
      rose.low = std::min(rose.low, v);
      rose.high = std::max(rose.high, v);
    }
  if (rose.high <= rose.low) rose.high = rose.low + 1;
  const std::vector<double> ticks = axis_ticks(rose.low, rose.high, 5);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : rose.high - rose.low;
  rose.high = step * std::ceil(rose.high / step - 1e-9);
  if (rose.low < 0) rose.low = step * std::floor(rose.low / step + 1e-9);

  TextStyle head;
  head.size_pt = 10.5;
  head.bold = true;
  d.text({0, 13}, title, head);
  draw_rings(d, rose, unit);
  draw_names(d, rose, axes);
  std::vector<LegendEntry> legend;
  for (const RadarSeries& s : series) {
    std::vector<Point2> outline;
    for (std::size_t k = 0; k < axes.size() && k < s.values.size(); ++k)
      outline.push_back(rose.at(k, s.values[k]));
    d.path(outline, true, filled(s.color, 0.10));
    d.path(outline, true, stroked(s.color, 1.8, s.dash_pt));
    for (const Point2& p : outline) d.circle(p, 2.4, filled(s.color));
    legend.push_back({s.name, stroked(s.color, 1.8, s.dash_pt)});
  }
  draw_legend(&d, {10, 340}, 420, legend);
  return d;
}

}  // namespace gnathion
