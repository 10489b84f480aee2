#include <algorithm>
#include <cmath>

#include "rendering/chart_axes.h"

namespace gnathion {
namespace {

constexpr double kPanelWidth = 262, kGap = 12, kRow = 14, kHead = 18, kFoot = 32, kLabel = 92;

double panel_height(const IntervalPanel& panel) {
  return kHead + kRow * static_cast<double>(panel.bars.size()) + 6 + kFoot;
}

Drawing draw_panel(const IntervalPanel& panel) {
  Drawing d(kPanelWidth, panel_height(panel));
  PlotArea area;
  area.corner = {kLabel, kHead};
  area.size = {kPanelWidth - kLabel - 10, kRow * static_cast<double>(panel.bars.size()) + 6};
  area.x_low = 0;
  area.x_high = 1e-6;
  for (const IntervalBar& b : panel.bars) {
    area.x_low = std::min(area.x_low, b.low);
    area.x_high = std::max(area.x_high, b.high);
  }
  const double margin = 0.06 * (area.x_high - area.x_low);
  area.x_high += margin;
  if (!panel.from_zero) area.x_low -= margin;

  TextStyle head, label;
  head.bold = true;
  label.size_pt = 7.5;
  label.anchor = Anchor::kEnd;
  d.text({0, 10}, text_fitted(panel.title, kPanelWidth, head.size_pt, true), head);
  draw_x_axis(d, area, 5, panel.x_label);
  const double bottom = area.corner.y() + area.size.y();
  d.line({area.x_pt(0), area.corner.y()}, {area.x_pt(0), bottom}, stroked(kMuted, 0.8));
  draw_frame(d, area);
  for (std::size_t i = 0; i < panel.bars.size(); ++i) {
    const IntervalBar& bar = panel.bars[i];
    const double y = area.corner.y() + 3 + kRow * (static_cast<double>(i) + 0.5);
    d.line({area.x_pt(bar.low), y}, {area.x_pt(bar.high), y}, stroked(safe_palette::kSky, 5));
    d.circle({area.x_pt(bar.mean), y}, 2.8, filled(kInk));
    d.text({kLabel - 5, y + 2.7}, text_fitted(bar.label, kLabel - 6, label.size_pt), label);
  }
  return d;
}

}  // namespace

Drawing interval_chart(const std::vector<IntervalPanel>& panels, const std::string& title,
                       const std::string& key) {
  double height = 24;
  for (std::size_t i = 0; i < panels.size(); i += 2)
    height += 6 + std::max(panel_height(panels[i]), i + 1 < panels.size() ? panel_height(panels[i + 1]) : 0);
  Drawing d(2 * kPanelWidth + kGap, height + 16);
  TextStyle head, fact;
  head.size_pt = 10.5;
  head.bold = true;
  fact.size_pt = 8;
  d.text({0, 13}, title, head);
  double y = 24;
  for (std::size_t i = 0; i < panels.size(); i += 2) {
    double tallest = 0;
    for (std::size_t k = i; k < std::min(i + 2, panels.size()); ++k) {
      auto panel = std::make_shared<Drawing>(draw_panel(panels[k]));
      tallest = std::max(tallest, panel->height_pt());
      d.place(panel, {static_cast<double>(k - i) * (kPanelWidth + kGap), y});
    }
    y += tallest + 6;
  }
  d.line({4, y + 6}, {24, y + 6}, stroked(safe_palette::kSky, 5));
  d.circle({14, y + 6}, 2.8, filled(kInk));
  d.text({30, y + 9}, text_fitted(key, d.width_pt() - 34, fact.size_pt), fact);
  return d;
}

}  // namespace gnathion
