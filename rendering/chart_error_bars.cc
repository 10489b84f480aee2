#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "rendering/chart_axes.h"

namespace gnathion {
namespace {

constexpr double kPanelWidth = 262, kGap = 12, kRow = 13, kHead = 30, kFoot = 32;
constexpr Color kBand = {0.80, 0.88, 0.96};

double panel_height(const ErrorBarPanel& panel) {
  return kHead + kRow * static_cast<double>(panel.bars.size()) + 6 + kFoot;
}

/// A round limit that holds every bar and band, the same on both sides of zero.
double common_limit(const std::vector<ErrorBarPanel>& panels) {
  double reach = 1e-6;
  for (const ErrorBarPanel& p : panels) {
    reach = std::max(reach, std::abs(p.weighted_mean) + p.band);
    for (const ErrorBar& b : p.bars) reach = std::max(reach, std::abs(b.avg) + b.std);
  }
  return reach * 1.04;
}

void draw_bar(Drawing& to, const PlotArea& area, const ErrorBar& bar, double y) {
  const Color color = bar.outlier ? safe_palette::kVermilion : kInk;
  const double left = area.x_pt(bar.avg - bar.std), right = area.x_pt(bar.avg + bar.std);
  to.line({left, y}, {right, y}, stroked(color, 1.1));
  for (const double x : {left, right}) to.line({x, y - 2.6}, {x, y + 2.6}, stroked(color, 1.1));
  Paint marker = filled(bar.outlier ? Color{1, 1, 1} : color);
  marker.stroke = color;
  marker.width_pt = 1.1;
  to.circle({area.x_pt(bar.avg), y}, 2.6, marker);
}

Drawing draw_panel(const ErrorBarPanel& panel, double limit, const std::string& x_label) {
  Drawing d(kPanelWidth, panel_height(panel));
  TextStyle head, fact, left, right;
  head.bold = true;
  fact.size_pt = 7.2;
  fact.color = kMuted;
  left.size_pt = right.size_pt = 7.5;
  left.anchor = right.anchor = Anchor::kEnd;
  right.color = kMuted;
  PlotArea area;
  area.corner = {58, kHead};
  area.size = {kPanelWidth - 58 - 50, kRow * static_cast<double>(panel.bars.size()) + 6};
  area.x_low = -limit;
  area.x_high = limit;

  d.text({0, 10}, text_fitted(panel.title, kPanelWidth, head.size_pt, true), head);
  d.text({0, 21},
         fmt::format("weighted mean {} mm, total STD {:.3f} mm, ΣN {}", signed_number(panel.weighted_mean, 4),
                     panel.band, grouped(panel.n_total)),
         fact);
  const double band_low = area.x_pt(panel.weighted_mean - panel.band);
  d.rectangle({band_low, area.corner.y()},
              {area.x_pt(panel.weighted_mean + panel.band) - band_low, area.size.y()}, filled(kBand));
  draw_x_axis(d, area, 5, x_label);
  const double bottom = area.corner.y() + area.size.y();
  d.line({area.x_pt(0), area.corner.y()}, {area.x_pt(0), bottom}, stroked(kMuted, 0.8));
  d.line({area.x_pt(panel.weighted_mean), area.corner.y()}, {area.x_pt(panel.weighted_mean), bottom},
         stroked(safe_palette::kBlue, 1.2, {4, 2}));
  draw_frame(d, area);
  for (std::size_t i = 0; i < panel.bars.size(); ++i) {
    const ErrorBar& bar = panel.bars[i];
    const double y = area.corner.y() + 3 + kRow * (static_cast<double>(i) + 0.5);
    draw_bar(d, area, bar, y);
    d.text({area.corner.x() - 5, y + 2.7}, text_fitted(bar.label, area.corner.x() - 6, left.size_pt), left);
    if (bar.n > 0) d.text({kPanelWidth - 1, y + 2.7}, grouped(bar.n), right);
  }
  right.color = kMuted;
  d.text({kPanelWidth - 1, kHead - 2.5}, "N", right);
  return d;
}

void draw_key(Drawing& to, double y) {
  TextStyle s;
  s.size_pt = 8;
  double x = 4;
  const auto say = [&](const std::string& text) {
    to.text({x, y + 3}, text, s);
    x += text_width_pt(text, s.size_pt) + 16;
  };
  const auto bar = [&](bool outlier) {
    PlotArea sample;
    sample.corner = {x, y};
    sample.size = {24, 1};
    draw_bar(to, sample, {"", 0.5, 0.5, 0, outlier}, y);
    x += 29;
  };
  bar(false);
  say("AVG ± 1 STD of one splint");
  bar(true);
  say("outlier");
  to.rectangle({x, y - 5}, {24, 10}, filled(kBand));
  to.line({x + 12, y - 5}, {x + 12, y + 5}, stroked(safe_palette::kBlue, 1.2, {4, 2}));
  x += 29;
  say("weighted mean ± total STD");
}

}  // namespace

Drawing error_bar_chart(const std::vector<ErrorBarPanel>& panels, const std::string& x_label,
                        const std::string& title) {
  const double limit = common_limit(panels);
  double height = 24;
  for (std::size_t i = 0; i < panels.size(); i += 2)
    height += 8 + std::max(panel_height(panels[i]), i + 1 < panels.size() ? panel_height(panels[i + 1]) : 0);
  Drawing d(panels.size() > 1 ? 2 * kPanelWidth + kGap : kPanelWidth + 110, height + 18);
  TextStyle head;
  head.size_pt = 10.5;
  head.bold = true;
  d.text({0, 13}, title, head);
  double y = 24;
  for (std::size_t i = 0; i < panels.size(); i += 2) {
    double tallest = 0;
    for (std::size_t k = i; k < std::min(i + 2, panels.size()); ++k) {
      auto panel = std::make_shared<Drawing>(draw_panel(panels[k], limit, x_label));
      tallest = std::max(tallest, panel->height_pt());
      d.place(panel, {static_cast<double>(k - i) * (kPanelWidth + kGap), y});
    }
    y += tallest + 8;
  }
  draw_key(d, y + 6);
  return d;
}

}  // namespace gnathion
