#include "rendering/plot.h"

#include <vtkAxis.h>
#include <vtkChartLegend.h>
#include <vtkChartXY.h>
#include <vtkContextScene.h>
#include <vtkContextView.h>
#include <vtkDoubleArray.h>
#include <vtkNew.h>
#include <vtkPen.h>
#include <vtkPlotLine.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkTable.h>
#include <vtkTextProperty.h>

#include <cmath>

#include "rendering/window.h"

namespace gnathion {
namespace {

constexpr int kFontSize_px = 20;
/// Room for labels around the axes: left, bottom, right, top.
constexpr double kMargin_px[4] = {110, 90, 40, 70};

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
void equalise(Ranges& r, const PlotOptions& o) {
  const double w = o.width_px - kMargin_px[0] - kMargin_px[2],
               h = o.height_px - kMargin_px[1] - kMargin_px[3];
  const double mm_per_px = std::max((r.x[1] - r.x[0]) / w, (r.y[1] - r.y[0]) / h);
  const auto widen = [&](Eigen::Vector2d& range, double px) {
    const double centre = 0.5 * (range[0] + range[1]), half = 0.5 * mm_per_px * px;
    range = {centre - half, centre + half};
  };
  widen(r.x, w);
  widen(r.y, h);
}

void style_axis(vtkAxis* axis, const std::string& label, const Eigen::Vector2d& range) {
  axis->SetTitle(label);
  axis->GetTitleProperties()->SetFontSize(kFontSize_px + 2);
  axis->GetTitleProperties()->SetBold(false);
  axis->GetLabelProperties()->SetFontSize(kFontSize_px);
  axis->SetBehavior(vtkAxis::FIXED);
  axis->SetRange(range[0], range[1]);
  axis->GetGridPen()->SetColor(225, 225, 225);
}

/// One plot per polyline; only the first of a curve has a name, so that the legend lists it once.
void add_curve(vtkChartXY& chart, const PlotCurve& curve) {
  bool named = false;
  for (const Polyline2& line : curve.lines) {
    if (line.size() < 2) continue;
    vtkNew<vtkTable> table;
    vtkNew<vtkDoubleArray> x, y;
    x->SetName("x");
    y->SetName(curve.name.c_str());
    for (const Eigen::Vector2d& p : line) {
      x->InsertNextValue(p.x());
      y->InsertNextValue(p.y());
    }
    table->AddColumn(x);
    table->AddColumn(y);
    vtkPlot* plot = chart.AddPlot(vtkChart::LINE);
    plot->SetInputData(table, 0, 1);
    plot->SetColor(curve.color[0], curve.color[1], curve.color[2]);
    plot->SetWidth(static_cast<float>(curve.width_px));
    plot->SetLegendVisibility(!named);
    plot->SetLabel(curve.name);
    named = true;
  }
}

}  // namespace

Status plot_curves(const std::filesystem::path& png, const std::vector<PlotCurve>& curves,
                   const PlotOptions& options) {
  GNATHION_TRY(auto window, offscreen_window(options.width_px, options.height_px));
  Ranges ranges{options.x_range, options.y_range};
  fit(ranges.x, curves, 0);
  fit(ranges.y, curves, 1);
  if (options.equal_axes) equalise(ranges, options);

  vtkNew<vtkContextView> view;
  view->SetRenderWindow(window);
  view->GetRenderer()->SetBackground(1, 1, 1);
  vtkNew<vtkChartXY> chart;
  view->GetScene()->AddItem(chart);
  chart->SetTitle(options.title);
  chart->GetTitleProperties()->SetFontSize(26);
  chart->SetShowLegend(true);
  chart->GetLegend()->SetLabelSize(kFontSize_px);
  chart->GetLegend()->SetInline(true);
  chart->SetLayoutStrategy(vtkChart::FILL_SCENE);
  for (const PlotCurve& curve : curves) add_curve(*chart, curve);
  style_axis(chart->GetAxis(vtkAxis::BOTTOM), options.x_label, ranges.x);
  style_axis(chart->GetAxis(vtkAxis::LEFT), options.y_label, ranges.y);
  return save_window(*window, png);
}

}  // namespace gnathion
