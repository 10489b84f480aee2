#include "rendering/chart_axes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

double tick_step(double low, double high, int about) {
  const double raw = (high - low) / std::max(1, about);
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  for (const double f : {1.0, 2.0, 5.0})
    if (raw <= f * power * 1.0000001) return f * power;
  return 10 * power;
}

std::string with_minus_sign(std::string text) {
  if (!text.empty() && text[0] == '-') {
    if (text.find_first_of("123456789") == std::string::npos) return text.substr(1);  // no −0.00
    text.replace(0, 1, "−");
  }
  return text;
}

TextStyle small(double size_pt, Anchor anchor) {
  TextStyle s;
  s.size_pt = size_pt;
  s.anchor = anchor;
  return s;
}

/// Liang & Barsky 1984: the part a + [t0, t1]·(b − a) inside the rectangle.
bool clip_segment(const Point2& a, const Point2& b, const Point2& low, const Point2& high, double& t0,
                  double& t1) {
  t0 = 0;
  t1 = 1;
  for (int axis = 0; axis < 2; ++axis) {
    const double d = b[axis] - a[axis];
    if (d == 0) {
      if (a[axis] < low[axis] || a[axis] > high[axis]) return false;
      continue;
    }
    double enter = (low[axis] - a[axis]) / d, leave = (high[axis] - a[axis]) / d;
    if (enter > leave) std::swap(enter, leave);
    t0 = std::max(t0, enter);
    t1 = std::min(t1, leave);
  }
  return t0 <= t1;
}

}  // namespace

std::vector<double> axis_ticks(double low, double high, int about) {
  std::vector<double> ticks;
  if (!(high > low)) return ticks;
  const double step = tick_step(low, high, about);
  for (double k = std::ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k)
    ticks.push_back(k * step);
  return ticks;
}

std::string tick_text(double value, double step) {
  const int decimals = std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 6);
  return with_minus_sign(fmt::format("{:.{}f}", value, decimals));
}

std::string signed_number(double value, int decimals, bool plus) {
  const std::string text = with_minus_sign(fmt::format("{:.{}f}", value, decimals));
  return plus && value > 0 && text.find_first_of("123456789") != std::string::npos ? "+" + text : text;
}

std::string grouped(double n) {
  std::string text = fmt::format("{:.0f}", n);
  for (std::ptrdiff_t at = static_cast<std::ptrdiff_t>(text.size()) - 3; at > 0; at -= 3)
    text.insert(static_cast<std::size_t>(at), "\u2009");
  return text;
}

void draw_frame(Drawing& to, const PlotArea& area) {
  to.rectangle(area.corner, area.size, stroked(kMuted, 0.6));
}

void draw_x_axis(Drawing& to, const PlotArea& area, int about, const std::string& label, double text_pt) {
  const double bottom = area.corner.y() + area.size.y();
  const std::vector<double> ticks = axis_ticks(area.x_low, area.x_high, about);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : 1;
  for (const double t : ticks) {
    to.line({area.x_pt(t), area.corner.y()}, {area.x_pt(t), bottom}, stroked(kFaint, 0.5));
    to.line({area.x_pt(t), bottom}, {area.x_pt(t), bottom + 2.5}, stroked(kMuted, 0.6));
    to.text({area.x_pt(t), bottom + 3.5 + text_pt}, tick_text(t, step), small(text_pt, Anchor::kMiddle));
  }
  if (!label.empty())
    to.text({area.corner.x() + area.size.x() / 2, bottom + 6 + 2.2 * text_pt}, label,
            small(text_pt + 0.5, Anchor::kMiddle));
}

void draw_y_axis(Drawing& to, const PlotArea& area, int about, const std::string& label, double text_pt) {
  const double left = area.corner.x();
  const std::vector<double> ticks = axis_ticks(area.y_low, area.y_high, about);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : 1;
  double widest = 0;
  for (const double t : ticks) {
    const std::string text = tick_text(t, step);
    widest = std::max(widest, text_width_pt(text, text_pt));
    to.line({left, area.y_pt(t)}, {left + area.size.x(), area.y_pt(t)}, stroked(kFaint, 0.5));
    to.line({left - 2.5, area.y_pt(t)}, {left, area.y_pt(t)}, stroked(kMuted, 0.6));
    to.text({left - 4, area.y_pt(t) + 0.36 * text_pt}, text, small(text_pt, Anchor::kEnd));
  }
  if (label.empty()) return;
  TextStyle style = small(text_pt + 0.5, Anchor::kMiddle);
  style.turn_deg = -90;
  to.text({left - 8 - widest, area.corner.y() + area.size.y() / 2}, label, style);
}

double draw_legend(Drawing* to, const Point2& corner, double width_pt,
                   const std::vector<LegendEntry>& entries) {
  constexpr double kSize = 8, kLine = 13, kSample = 22, kGap = 14;
  Point2 at = corner;
  for (const LegendEntry& e : entries) {
    const double width = kSample + 4 + text_width_pt(e.name, kSize);
    if (at.x() > corner.x() && at.x() + width > corner.x() + width_pt) at = {corner.x(), at.y() + kLine};
    if (to) {
      if (e.paint.fill && e.paint.width_pt == 0)
        to->rectangle(at + Point2(2, 2), {kSample - 6, 7}, e.paint);
      else
        to->line(at + Point2(0, 5.5), at + Point2(kSample - 2, 5.5), e.paint);
      to->text(at + Point2(kSample + 2, 8.5), e.name, small(kSize, Anchor::kStart));
    }
    at.x() += width + kGap;
  }
  return entries.empty() ? 0 : at.y() - corner.y() + kLine;
}

std::vector<Polyline2> clipped(const Polyline2& line, const Point2& low, const Point2& high) {
  std::vector<Polyline2> pieces;
  bool open = false;  // the last piece ends where the next segment begins
  for (std::size_t i = 1; i < line.size(); ++i) {
    double t0 = 0, t1 = 1;
    if (!clip_segment(line[i - 1], line[i], low, high, t0, t1)) {
      open = false;
      continue;
    }
    const Point2 d = line[i] - line[i - 1];
    if (!open || t0 > 0) pieces.push_back({line[i - 1] + t0 * d});
    pieces.back().push_back(line[i - 1] + t1 * d);
    open = t1 >= 1;
  }
  return pieces;
}

}  // namespace gnathion
