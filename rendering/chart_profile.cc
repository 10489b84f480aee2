#include <algorithm>

#include "rendering/chart_axes.h"

namespace gnathion {

Drawing profile_chart(const std::vector<ProfileCurve>& curves, const Point2& centre, const Point2& half_size,
                      const std::string& x_label, const std::string& y_label, const std::string& title,
                      const std::string& note) {
  constexpr double kLeft = 42, kTop = 34, kPlotWidth = 236;
  std::vector<LegendEntry> legend;
  for (const ProfileCurve& c : curves) {
    const auto known = [&](const LegendEntry& e) { return e.name == c.name; };
    if (!c.lines.empty() && std::none_of(legend.begin(), legend.end(), known))
      legend.push_back({c.name, c.paint});
  }
  const double scale = kPlotWidth / (2 * half_size.x()), plot_height = 2 * half_size.y() * scale;
  const double legend_height = draw_legend(nullptr, {0, 0}, kLeft + kPlotWidth, legend);
  Drawing d(kLeft + kPlotWidth + 8, kTop + plot_height + 32 + legend_height);
  PlotArea area{{kLeft, kTop},
                {kPlotWidth, plot_height},
                centre.x() - half_size.x(),
                centre.x() + half_size.x(),
                centre.y() - half_size.y(),
                centre.y() + half_size.y()};
  TextStyle head, fact;
  head.bold = true;
  fact.size_pt = 7.2;
  fact.color = kMuted;
  d.text({0, 10}, text_fitted(title, d.width_pt(), head.size_pt, true), head);
  const std::vector<std::string> notes = text_wrapped(note, d.width_pt(), fact.size_pt);
  d.text({0, 21}, notes.size() > 1 ? text_fitted(note, d.width_pt(), fact.size_pt) : note, fact);
  draw_x_axis(d, area, 6, x_label);
  draw_y_axis(d, area, 6, y_label);
  const Point2 low = centre - half_size, high = centre + half_size;
  for (const ProfileCurve& c : curves)
    for (const Polyline2& line : c.lines)
      for (const Polyline2& piece : clipped(line, low, high)) {
        std::vector<Point2> points;
        for (const Point2& p : piece) points.push_back(area.at(p.x(), p.y()));
        d.path(std::move(points), false, c.paint);
      }
  draw_frame(d, area);
  draw_legend(&d, {4, kTop + plot_height + 30}, kLeft + kPlotWidth, legend);
  return d;
}

}  // namespace gnathion
