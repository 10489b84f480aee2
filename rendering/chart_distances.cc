// Signed distances: the colour map, the histogram, the map with its colour bar.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "rendering/chart_axes.h"

namespace gnathion {

Color diverging_color(double value) {
  // Blue against orange-brown, equally dark at both ends: told apart with any of the usual colour blindnesses
  // and, by lightness, how far from zero even in grey.
  static constexpr std::array<Color, 9> anchors = {{{0.03, 0.19, 0.42},
                                                    {0.13, 0.40, 0.67},
                                                    {0.36, 0.61, 0.81},
                                                    {0.71, 0.84, 0.92},
                                                    {0.96, 0.96, 0.94},
                                                    {0.99, 0.83, 0.58},
                                                    {0.93, 0.58, 0.24},
                                                    {0.72, 0.36, 0.07},
                                                    {0.43, 0.17, 0.02}}};
  const double place = (std::clamp(value, -1.0, 1.0) + 1) / 2 * (anchors.size() - 1);
  const std::size_t i = std::min(static_cast<std::size_t>(place), anchors.size() - 2);
  const double f = place - static_cast<double>(i);
  Color c;
  for (std::size_t k = 0; k < 3; ++k) c[k] = (1 - f) * anchors[i][k] + f * anchors[i + 1][k];
  return c;
}

Histogram histogram_of(const std::vector<double>& values, double low, double high, std::size_t bins) {
  Histogram h;
  h.low = low;
  h.high = high;
  h.counts.assign(bins, 0);
  double sum = 0, squares = 0;
  for (const double v : values) {
    sum += v;
    if (v < low)
      ++h.below;
    else if (v >= high)
      ++h.above;
    else
      ++h.counts[std::min(bins - 1,
                          static_cast<std::size_t>((v - low) / (high - low) * static_cast<double>(bins)))];
  }
  h.n = static_cast<double>(values.size());
  if (values.empty()) return h;
  h.avg = sum / h.n;
  for (const double v : values) squares += (v - h.avg) * (v - h.avg);
  h.std = std::sqrt(squares / h.n);
  return h;
}

Drawing histogram_chart(const Histogram& h, double color_range, const std::string& x_label,
                        const std::string& title) {
  Drawing d(300, 204);
  TextStyle head, fact;
  head.bold = true;
  fact.size_pt = 7.5;
  fact.color = kMuted;
  d.text({0, 10}, text_fitted(title, 300, head.size_pt, true), head);
  d.text({0, 21},
         fmt::format("N {}, AVG {} mm, STD {:.3f} mm; beyond the axis {:.2f} %", grouped(h.n),
                     signed_number(h.avg, 3), h.std, h.n > 0 ? 100 * (h.below + h.above) / h.n : 0.0),
         fact);
  double top = 1e-9;
  for (const double c : h.counts) top = std::max(top, h.n > 0 ? 100 * c / h.n : 0);
  PlotArea area{{46, 30}, {246, 136}, h.low, h.high, 0, top * 1.06};
  draw_y_axis(d, area, 5, "share of points [%]");
  draw_x_axis(d, area, 6, x_label);
  const double width = (h.high - h.low) / static_cast<double>(h.counts.size());
  for (std::size_t i = 0; i < h.counts.size(); ++i) {
    if (h.counts[i] <= 0) continue;
    const double x = h.low + width * static_cast<double>(i), y = 100 * h.counts[i] / h.n;
    Paint paint = filled(diverging_color((x + width / 2) / color_range));
    paint.stroke = kMuted;
    paint.width_pt = 0.3;
    d.rectangle(area.at(x, y), {area.x_pt(x + width) - area.x_pt(x), area.y_pt(0) - area.y_pt(y)}, paint);
  }
  const auto mark = [&](double x, const Paint& paint) {
    if (x > h.low && x < h.high) d.line(area.at(x, 0), area.at(x, area.y_high), paint);
  };
  mark(0, stroked(kMuted, 0.7));
  mark(h.avg, stroked(kInk, 1.2));
  for (const double s : {-h.std, h.std}) mark(h.avg + s, stroked(kInk, 1.0, {3, 2}));
  draw_frame(d, area);
  fact.anchor = Anchor::kEnd;
  d.text({292, 203}, "solid line: AVG; dashed: ±1 STD", fact);
  return d;
}

namespace {

void draw_color_bar(Drawing& to, const Point2& corner, double height, double range_mm,
                    bool has_not_measured) {
  constexpr int kSteps = 60;
  constexpr double kWidth = 11;
  for (int i = 0; i < kSteps; ++i) {
    const double v = 1 - 2 * (i + 0.5) / kSteps;
    // A little taller than its step, so that no viewer shows seams.
    to.rectangle(corner + Point2(0, height * i / kSteps),
                 {kWidth, height / kSteps + (i + 1 < kSteps ? 0.4 : 0)}, filled(diverging_color(v)));
  }
  to.rectangle(corner, {kWidth, height}, stroked(kMuted, 0.5));
  TextStyle style;
  style.size_pt = 7.5;
  const std::vector<double> ticks = axis_ticks(-range_mm, range_mm, 9);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : range_mm;
  double widest = 0;
  for (const double t : ticks) {
    const double y = corner.y() + height * (range_mm - t) / (2 * range_mm);
    to.line({corner.x() + kWidth, y}, {corner.x() + kWidth + 2.5, y}, stroked(kMuted, 0.6));
    const std::string text = (t > 0 ? "+" : "") + tick_text(t, step);
    to.text({corner.x() + kWidth + 5, y + 2.7}, text, style);
    widest = std::max(widest, text_width_pt(text, style.size_pt));
  }
  TextStyle label = style;
  label.turn_deg = -90;
  label.anchor = Anchor::kMiddle;
  to.text({corner.x() + kWidth + 16 + widest, corner.y() + height / 2}, "signed distance [mm], + outside",
          label);
  if (!has_not_measured) return;
  to.rectangle(corner + Point2(0, height + 8), {kWidth, 9}, filled(kNotMeasured));
  to.text(corner + Point2(kWidth + 5, height + 15.5), "not measured", style);
}

/// One, ten or a hundred millimetres: what fits under the colour bar. All views are drawn to one scale.
void draw_scale_bar(Drawing& to, const Point2& left, double pt_per_mm) {
  double length_mm = 0.1;
  while (length_mm * 10 * pt_per_mm < 60) length_mm *= 10;
  const double width = length_mm * pt_per_mm;
  const Point2 right_end = left + Point2(width, 0);
  to.path({left - Point2(0, 3), left, right_end, right_end - Point2(0, 3)}, false, stroked(kInk, 1.2));
  TextStyle style;
  style.size_pt = 7.5;
  style.anchor = Anchor::kMiddle;
  to.text({(left.x() + right_end.x()) / 2, right_end.y() - 4.5}, fmt::format("{:g} mm", length_mm), style);
}

}  // namespace

Drawing distance_map_figure(const std::vector<DistanceMapView>& views, double range_mm,
                            const std::string& title, const std::vector<std::string>& facts,
                            bool has_not_measured) {
  constexpr double kHeight = 190, kTop = 18;
  double width = 0;
  for (const DistanceMapView& v : views) width += kHeight * v.width_px / v.height_px + 4;
  TextStyle head, fact;
  head.bold = true;
  fact.size_pt = 8;
  fact.color = kMuted;
  const double full = width + 84;
  std::vector<std::string> lines;
  for (const std::string& f : facts)
    for (const std::string& line : text_wrapped(f, full, fact.size_pt)) lines.push_back(line);
  Drawing d(full, kTop + kHeight + 6 + 11.5 * static_cast<double>(lines.size()));
  d.text({0, 11}, text_fitted(title, full, head.size_pt, true), head);
  double x = 0;
  for (const DistanceMapView& v : views) {
    const double w = kHeight * v.width_px / v.height_px;
    d.image({x, kTop}, {w, kHeight}, v.png, v.jpeg);
    x += w + 4;
  }
  draw_color_bar(d, {x + 8, kTop + 10}, kHeight - 66, range_mm, has_not_measured);
  if (!views.empty())
    draw_scale_bar(d, {x + 8, kTop + kHeight - 4},
                   views.front().px_per_mm * kHeight / views.front().height_px);
  for (std::size_t i = 0; i < lines.size(); ++i)
    d.text({0, kTop + kHeight + 12 + 11.5 * static_cast<double>(i)}, lines[i], fact);
  return d;
}

}  // namespace gnathion
