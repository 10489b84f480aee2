// A plot's rectangle with its scales and ticks; internal to the charts.
#pragma once

#include <string>
#include <vector>

#include "rendering/charts.h"

namespace gnathion {

inline constexpr Color kInk = {0.11, 0.14, 0.19};
inline constexpr Color kFaint = {0.86, 0.88, 0.91};
inline constexpr Color kMuted = {0.36, 0.40, 0.46};

/// Data coordinates in a rectangle of the page; y upwards.
struct PlotArea {
  Point2 corner{0, 0}, size{1, 1};  ///< pt
  double x_low = 0, x_high = 1, y_low = 0, y_high = 1;

  double x_pt(double x) const { return corner.x() + (x - x_low) / (x_high - x_low) * size.x(); }
  double y_pt(double y) const { return corner.y() + (y_high - y) / (y_high - y_low) * size.y(); }
  Point2 at(double x, double y) const { return {x_pt(x), y_pt(y)}; }
};

/// Grid lines and tick labels under the area; the label below them, if any.
void draw_x_axis(Drawing& to, const PlotArea& area, int about, const std::string& label,
                 double text_pt = 7.5);
/// The same at the left; the label reads upwards.
void draw_y_axis(Drawing& to, const PlotArea& area, int about, const std::string& label,
                 double text_pt = 7.5);
void draw_frame(Drawing& to, const PlotArea& area);

struct LegendEntry {
  std::string name;
  Paint paint;
};
/// Entries flow in lines no wider than `width_pt`; gives the height used. `to` may be null: measure only.
double draw_legend(Drawing* to, const Point2& corner, double width_pt,
                   const std::vector<LegendEntry>& entries);

/// 12345678 with thin spaces between thousands.
std::string grouped(double n);
/// The part of a polyline inside a rectangle, as pieces.
std::vector<Polyline2> clipped(const Polyline2& line, const Point2& low, const Point2& high);

}  // namespace gnathion
