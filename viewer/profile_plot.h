// The cross-section as a measured plot.
#pragma once

#include <QWidget>

#include "rendering/plot.h"

namespace gnathion {

/// Draws section curves with a millimetre grid. The wheel zooms, dragging pans; equal axes always.
class ProfilePlot : public QWidget {
 public:
  explicit ProfilePlot(QWidget* parent = nullptr);
  void set_curves(std::vector<PlotCurve> curves);
  const std::vector<PlotCurve>& curves() const { return curves_; }
  QSize sizeHint() const override { return {460, 380}; }

 protected:
  void paintEvent(QPaintEvent* event) override;
  void wheelEvent(QWheelEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;

 private:
  QPointF to_widget(const Eigen::Vector2d& p_mm) const;
  void draw_grid(QPainter& painter) const;
  void draw_legend(QPainter& painter) const;

  std::vector<PlotCurve> curves_;
  Eigen::Vector2d centre_mm_{0, 0};
  double px_per_mm_ = 16.0;
  QPoint last_mouse_;
};

}  // namespace gnathion
