// Curves in millimetres with equal axes: the cross-section as a measured plot, paths of the jaw.
#pragma once

#include <QWidget>
#include <optional>

#include "rendering/plot.h"
#include "viewer/model/measure.h"

namespace gnathion {

/// Wheel zooms, dragging pans; while something is measured, clicks set points, which snap to the curves.
class ProfilePlot : public QWidget {
 public:
  explicit ProfilePlot(QWidget* parent = nullptr);
  void set_curves(std::vector<PlotCurve> curves);
  const std::vector<PlotCurve>& curves() const { return curves_; }
  void set_axes(const QString& x, const QString& y);
  void set_note(const QString& text);  ///< shown where there is nothing to draw
  void fit();                          ///< all curves in the window
  void look_at(const Eigen::Vector2d& centre_mm, double half_width_mm);
  void set_measuring(std::optional<Measure> what);
  /// The points set so far and what they say: "2.31 mm", "88.4°".
  const QString& measured() const { return measured_; }
  QPointF to_widget(const Eigen::Vector2d& p_mm) const;
  void set_marker(const Eigen::Vector2d& p_mm, bool shown);
  QSize sizeHint() const override { return {300, 280}; }

 protected:
  void paintEvent(QPaintEvent* event) override;
  void wheelEvent(QWheelEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void mouseDoubleClickEvent(QMouseEvent*) override { fit(); }

 private:
  Eigen::Vector2d to_mm(const QPointF& px) const;
  struct OnCurve;
  std::optional<OnCurve> nearest_curve(const QPointF& px) const;
  void measure_wall(const QPointF& px);
  void draw_grid(QPainter& painter) const;
  void draw_legend(QPainter& painter) const;
  void draw_measure(QPainter& painter) const;

  std::vector<PlotCurve> curves_;
  QString x_label_ = "mm", y_label_, note_, measured_;
  Eigen::Vector2d centre_mm_{0, 0}, marker_mm_{0, 0};
  double px_per_mm_ = 14.0;
  QPoint last_mouse_;
  std::optional<Measure> measuring_;
  bool marker_ = false;
  std::vector<Eigen::Vector2d> points_mm_;
};

}  // namespace gnathion
