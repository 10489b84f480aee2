// The figures of an evaluation as vector drawings: each with axis, unit and N, in colours that the
// colour-blind can tell apart, and never by colour alone.
#pragma once

#include <string>
#include <vector>

#include "core/mesh_section.h"
#include "rendering/drawing.h"

namespace gnathion {

/// Colours that differ in lightness and survive red-green blindness (after Okabe & Ito 2008).
namespace safe_palette {
inline constexpr Color kBlue = {0.00, 0.45, 0.70};
inline constexpr Color kOrange = {0.90, 0.62, 0.00};
inline constexpr Color kGreen = {0.00, 0.62, 0.45};
inline constexpr Color kVermilion = {0.84, 0.37, 0.00};
inline constexpr Color kPurple = {0.80, 0.47, 0.65};
inline constexpr Color kSky = {0.34, 0.71, 0.91};
inline constexpr Color kGrey = {0.45, 0.45, 0.45};
}  // namespace safe_palette

/// Diverging map for signed distances: −1 dark blue, 0 near white, +1 dark orange-brown; clamped outside.
Color diverging_color(double value);
/// What lies off the map: points without a trustworthy sign, peripheral ones.
inline constexpr Color kNotMeasured = {0.62, 0.62, 0.62};

/// One measured thing: mean ± standard deviation over n points.
struct ErrorBar {
  std::string label;
  double avg = 0, std = 0;
  double n = 0;
  bool outlier = false;  ///< hollow marker, and said in the label
};
/// One procedure over all splints.
struct ErrorBarPanel {
  std::string title;
  std::vector<ErrorBar> bars;
  double weighted_mean = 0, band = 0;  ///< shaded: weighted mean ± band (total STD)
  double n_total = 0;
};
/// Panels in two columns, one horizontal scale for all, mean as marker and ±1 STD as horizontal bar.
Drawing error_bar_chart(const std::vector<ErrorBarPanel>& panels, const std::string& x_label,
                        const std::string& title);

/// A figure with the range that most of its draws fall into.
struct IntervalBar {
  std::string label;
  double mean = 0, low = 0, high = 0;
};
struct IntervalPanel {
  std::string title, x_label;
  std::vector<IntervalBar> bars;
  bool from_zero = false;  ///< the figure cannot be negative
};
/// Panels in two columns, each with its own scale. `key` says what marker and bar are, and the number of
/// draws.
Drawing interval_chart(const std::vector<IntervalPanel>& panels, const std::string& title,
                       const std::string& key);

struct RadarSeries {
  std::string name;
  std::vector<double> values;  ///< one for each axis
  Color color = {0, 0, 0};
  std::vector<double> dash_pt;
};
/// One spoke for each name (at least three); rings carry the unit. Zero is the centre where no value is
/// negative, else it is a marked ring.
Drawing radar_chart(const std::vector<std::string>& axes, const std::vector<RadarSeries>& series,
                    const std::string& unit, const std::string& title);

struct Histogram {
  double low = 0, high = 0;     ///< range of the bins
  std::vector<double> counts;   ///< equal bins
  double below = 0, above = 0;  ///< counts outside the range
  double n = 0, avg = 0, std = 0;
};
Histogram histogram_of(const std::vector<double>& values, double low, double high, std::size_t bins);
/// Bars in per cent of N, coloured as a distance map of ±color_range, with AVG and ±1 STD marked.
Drawing histogram_chart(const Histogram& histogram, double color_range, const std::string& x_label,
                        const std::string& title);

/// One outline of a cross-section.
struct ProfileCurve {
  std::string name;  ///< curves of one name share a legend entry
  Paint paint;
  std::vector<Polyline2> lines;  ///< mm
};
/// Equal axes; `centre` and `half_size` (mm) choose the window. `note` stands under the title.
Drawing profile_chart(const std::vector<ProfileCurve>& curves, const Point2& centre, const Point2& half_size,
                      const std::string& x_label, const std::string& y_label, const std::string& title,
                      const std::string& note);

/// A rendered view with a colour bar from −range to +range, scale bar and statistics, all but the view itself
/// as vectors. `px_per_mm` of the view; `facts` are printed one a line under it.
struct DistanceMapView {
  std::string png, jpeg;
  int width_px = 0, height_px = 0;
  double px_per_mm = 0;
};
Drawing distance_map_figure(const std::vector<DistanceMapView>& views, double range_mm,
                            const std::string& title, const std::vector<std::string>& facts,
                            bool has_not_measured);

/// Round steps (1, 2, 5 × 10ⁿ) that cover a range.
std::vector<double> axis_ticks(double low, double high, int about);
/// A number with a true minus sign, `decimals` after the point; `plus` writes a + before positive ones.
std::string signed_number(double value, int decimals, bool plus = false);
/// A number with the tick step's decimals, and a true minus sign.
std::string tick_text(double value, double step);

}  // namespace gnathion
