#include "viewer/profile_plot.h"

#include <QMouseEvent>
#include <QPainter>
#include <QPainterPath>
#include <QWheelEvent>
#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

QColor to_qcolor(const Color& c) {
  return QColor::fromRgbF(c[0], c[1], c[2]);
}

}  // namespace

ProfilePlot::ProfilePlot(QWidget* parent) : QWidget(parent) {
  setMinimumSize(320, 260);
  setToolTip("Cross-section in the plane of the 3D view. Wheel: zoom. Drag: pan.");
}

void ProfilePlot::set_curves(std::vector<PlotCurve> curves) {
  curves_ = std::move(curves);
  update();
}

QPointF ProfilePlot::to_widget(const Eigen::Vector2d& p) const {
  return {width() / 2.0 + (p.x() - centre_mm_.x()) * px_per_mm_,
          height() / 2.0 - (p.y() - centre_mm_.y()) * px_per_mm_};
}

void ProfilePlot::draw_grid(QPainter& painter) const {
  const double step = px_per_mm_ > 40 ? 0.5 : px_per_mm_ > 14 ? 1.0 : px_per_mm_ > 6 ? 2.0 : 5.0;
  const double half_w = width() / 2.0 / px_per_mm_, half_h = height() / 2.0 / px_per_mm_;
  const int label_every = px_per_mm_ * step > 34 ? 1 : 2;
  painter.setFont(QFont(font().family(), 8));
  const auto line = [&](double mm, bool vertical) {
    const QPointF at = to_widget(vertical ? Eigen::Vector2d(mm, 0) : Eigen::Vector2d(0, mm));
    painter.setPen(QColor(228, 230, 234));
    if (vertical)
      painter.drawLine(QPointF(at.x(), 0), QPointF(at.x(), height()));
    else
      painter.drawLine(QPointF(0, at.y()), QPointF(width(), at.y()));
    if (static_cast<long>(std::lround(mm / step)) % label_every != 0) return;
    painter.setPen(QColor(110, 116, 128));
    const QString text = QString::number(mm, 'g', 4);
    if (vertical)
      painter.drawText(QPointF(at.x() + 2, height() - 4), text);
    else
      painter.drawText(QPointF(3, at.y() - 2), text);
  };
  for (double x = std::ceil((centre_mm_.x() - half_w) / step) * step; x < centre_mm_.x() + half_w; x += step)
    line(x, true);
  for (double y = std::ceil((centre_mm_.y() - half_h) / step) * step; y < centre_mm_.y() + half_h; y += step)
    line(y, false);
}

void ProfilePlot::draw_legend(QPainter& painter) const {
  painter.setFont(QFont(font().family(), 9));
  const int row = 18;
  int y = 8;
  painter.fillRect(QRect(width() - 152, 4, 148, row * static_cast<int>(curves_.size()) + 26),
                   QColor(255, 255, 255, 215));
  for (const PlotCurve& c : curves_) {
    painter.setPen(QPen(to_qcolor(c.color), c.width_px));
    painter.drawLine(width() - 146, y + row / 2, width() - 122, y + row / 2);
    painter.setPen(QColor(40, 44, 52));
    painter.drawText(QRect(width() - 116, y, 112, row), Qt::AlignVCenter | Qt::AlignLeft,
                     QString::fromStdString(c.name));
    y += row;
  }
  painter.setPen(QColor(110, 116, 128));
  painter.drawText(QRect(width() - 146, y, 140, row), Qt::AlignVCenter | Qt::AlignLeft, "axes in mm");
}

void ProfilePlot::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.fillRect(rect(), Qt::white);
  draw_grid(painter);
  painter.setRenderHint(QPainter::Antialiasing);
  for (const PlotCurve& c : curves_) {
    painter.setPen(QPen(to_qcolor(c.color), c.width_px, Qt::SolidLine, Qt::RoundCap, Qt::RoundJoin));
    for (const Polyline2& line : c.lines) {
      QPolygonF polygon;
      for (const Eigen::Vector2d& p : line) polygon << to_widget(p);
      painter.drawPolyline(polygon);
    }
  }
  draw_legend(painter);
}

void ProfilePlot::wheelEvent(QWheelEvent* event) {
  px_per_mm_ = std::clamp(px_per_mm_ * std::pow(1.0015, event->angleDelta().y()), 3.0, 400.0);
  update();
}

void ProfilePlot::mousePressEvent(QMouseEvent* event) {
  last_mouse_ = event->pos();
}

void ProfilePlot::mouseMoveEvent(QMouseEvent* event) {
  const QPoint d = event->pos() - last_mouse_;
  last_mouse_ = event->pos();
  centre_mm_ += Eigen::Vector2d(-d.x(), d.y()) / px_per_mm_;
  update();
}

}  // namespace gnathion
