#include "viewer/widgets/profile_plot.h"

#include <QMouseEvent>
#include <QPainter>
#include <QWheelEvent>
#include <algorithm>
#include <cmath>
#include <set>

namespace gnathion {
namespace {

constexpr double kSnapPx = 10.0;
const QColor kInk(28, 36, 48), kFaint(226, 229, 234), kTick(96, 103, 116), kMeasure(181, 71, 0);

QColor to_qcolor(const Color& c) {
  return QColor::fromRgbF(c[0], c[1], c[2]);
}

/// How far along the ray it meets the line.
void add_crossings(const Polyline2& line, const Eigen::Vector2d& from, const Eigen::Vector2d& way,
                   std::vector<double>& out) {
  const auto across = [&](const Eigen::Vector2d& p) {
    return way.x() * (p - from).y() - way.y() * (p - from).x();
  };
  for (std::size_t i = 0; i + 1 < line.size(); ++i) {
    const double a = across(line[i]), b = across(line[i + 1]);
    if ((a < 0) == (b < 0)) continue;
    const double at = way.dot(line[i] + a / (a - b) * (line[i + 1] - line[i]) - from);
    if (at > 0) out.push_back(at);
  }
}

}  // namespace

ProfilePlot::ProfilePlot(QWidget* parent) : QWidget(parent) {
  setMinimumSize(220, 180);
  setToolTip("Wheel: zoom. Drag: move. Double click: show all.");
}

void ProfilePlot::set_curves(std::vector<PlotCurve> curves) {
  curves_ = std::move(curves);
  update();
}

void ProfilePlot::set_axes(const QString& x, const QString& y) {
  x_label_ = x;
  y_label_ = y;
}

void ProfilePlot::set_note(const QString& text) {
  note_ = text;
  update();
}

void ProfilePlot::set_marker(const Eigen::Vector2d& p_mm, bool shown) {
  marker_mm_ = p_mm;
  marker_ = shown;
  update();
}

void ProfilePlot::set_measuring(std::optional<Measure> what) {
  measuring_ = what;
  points_mm_.clear();
  measured_.clear();
  setCursor(what ? Qt::CrossCursor : Qt::ArrowCursor);
  update();
}

void ProfilePlot::fit() {
  Eigen::Vector2d low(1e9, 1e9), high(-1e9, -1e9);
  for (const PlotCurve& c : curves_)
    for (const Polyline2& line : c.lines)
      for (const Eigen::Vector2d& p : line) low = low.cwiseMin(p), high = high.cwiseMax(p);
  if (low.x() > high.x()) return;
  centre_mm_ = 0.5 * (low + high);
  const Eigen::Vector2d size = (high - low).cwiseMax(0.5);
  px_per_mm_ = std::clamp(0.82 * std::min(width() / size.x(), (height() - 24) / size.y()), 2.0, 400.0);
  update();
}

void ProfilePlot::look_at(const Eigen::Vector2d& centre_mm, double half_width_mm) {
  centre_mm_ = centre_mm;
  px_per_mm_ = std::min(width(), height()) / (2.0 * half_width_mm);
  update();
}

QPointF ProfilePlot::to_widget(const Eigen::Vector2d& p) const {
  return {width() / 2.0 + (p.x() - centre_mm_.x()) * px_per_mm_,
          height() / 2.0 - (p.y() - centre_mm_.y()) * px_per_mm_};
}

Eigen::Vector2d ProfilePlot::to_mm(const QPointF& px) const {
  return {centre_mm_.x() + (px.x() - width() / 2.0) / px_per_mm_,
          centre_mm_.y() - (px.y() - height() / 2.0) / px_per_mm_};
}

struct ProfilePlot::OnCurve {
  Eigen::Vector2d at_mm, along;  ///< unit
  std::string curve;
};

/// The nearest point of a curve, if one is near.
std::optional<ProfilePlot::OnCurve> ProfilePlot::nearest_curve(const QPointF& px) const {
  const Eigen::Vector2d p = to_mm(px);
  std::optional<OnCurve> best;
  double nearest = kSnapPx / px_per_mm_;
  for (const PlotCurve& c : curves_)
    for (const Polyline2& line : c.lines)
      for (std::size_t i = 0; i + 1 < line.size(); ++i) {
        const Eigen::Vector2d d = line[i + 1] - line[i];
        const double l2 = d.squaredNorm();
        if (l2 == 0) continue;
        const Eigen::Vector2d q = line[i] + std::clamp((p - line[i]).dot(d) / l2, 0.0, 1.0) * d;
        if ((q - p).norm() < nearest) nearest = (q - p).norm(), best = OnCurve{q, d.normalized(), c.name};
      }
  return best;
}

/// Across the curve under the mouse to its next crossing, on the side that lies inside of it.
void ProfilePlot::measure_wall(const QPointF& px) {
  points_mm_.clear();
  const auto from = nearest_curve(px);
  measured_ = from ? "no wall behind this point" : "click on a profile";
  points_mm_.push_back(from ? from->at_mm : to_mm(px));
  if (!from) return;
  double thinnest = kThickestMm;
  for (const double side : {1.0, -1.0}) {
    const Eigen::Vector2d way = side * Eigen::Vector2d(-from->along.y(), from->along.x());
    std::vector<double> crossings;
    for (const PlotCurve& c : curves_) {
      if (c.name != from->curve) continue;
      for (const Polyline2& line : c.lines) add_crossings(line, from->at_mm + 0.02 * way, way, crossings);
    }
    if (crossings.size() % 2 == 0) continue;  // that side is outside
    const double wall = 0.02 + *std::min_element(crossings.begin(), crossings.end());
    if (wall >= thinnest) continue;
    thinnest = wall;
    points_mm_.resize(1);
    points_mm_.push_back(from->at_mm + wall * way);
    measured_ = QString("%1 mm thick").arg(wall, 0, 'f', 2);
  }
}

void ProfilePlot::draw_grid(QPainter& painter) const {
  double step = 0.1;
  for (const double s : {0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0})
    if ((step = s) * px_per_mm_ >= 38) break;
  painter.setFont(QFont(font().family(), 8));
  const Eigen::Vector2d low = to_mm(QPointF(0, height())), high = to_mm(QPointF(width(), 0));
  const auto text = [&](double v) {
    return QString::number(std::abs(v) < 1e-9 ? 0.0 : v, 'f', step < 1 ? 1 : 0).replace('-', QChar(0x2212));
  };
  for (double x = std::ceil(low.x() / step) * step; x < high.x(); x += step) {
    const double at = to_widget({x, 0}).x();
    painter.setPen(kFaint);
    painter.drawLine(QPointF(at, 0), QPointF(at, height()));
    painter.setPen(kTick);
    if (at > 30 && at < width() - 40)
      painter.drawText(QRectF(at - 20, height() - 16, 40, 14), Qt::AlignCenter, text(x));
  }
  for (double y = std::ceil(low.y() / step) * step; y < high.y(); y += step) {
    const double at = to_widget({0, y}).y();
    painter.setPen(kFaint);
    painter.drawLine(QPointF(0, at), QPointF(width(), at));
    painter.setPen(kTick);
    if (at > 36 && at < height() - 24) painter.drawText(QRectF(3, at - 15, 40, 14), Qt::AlignLeft, text(y));
  }
  painter.setPen(kTick);
  painter.drawText(QRectF(width() - 240, height() - 30, 236, 14), Qt::AlignRight, x_label_);
  painter.drawText(QRectF(3, 3, width() / 2.0, 14), Qt::AlignLeft, y_label_);
}

void ProfilePlot::draw_legend(QPainter& painter) const {
  painter.setFont(QFont(font().family(), 8));
  std::set<std::string> seen;
  std::vector<const PlotCurve*> entries;
  int text_w = 0;
  for (const PlotCurve& c : curves_)
    if (!c.lines.empty() && !c.name.empty() && seen.insert(c.name).second) {
      entries.push_back(&c);
      text_w = std::max(text_w, painter.fontMetrics().horizontalAdvance(QString::fromStdString(c.name)));
    }
  if (entries.empty()) return;
  const int row = 15, w = text_w + 38, x = width() - w - 4;
  painter.fillRect(QRect(x, 4, w, row * static_cast<int>(entries.size()) + 6), QColor(255, 255, 255, 225));
  int y = 7;
  for (const PlotCurve* c : entries) {
    painter.setPen(QPen(to_qcolor(c->color), std::max(2.0, c->width_px)));
    painter.drawLine(x + 5, y + row / 2, x + 26, y + row / 2);
    painter.setPen(kInk);
    painter.drawText(QRect(x + 31, y, text_w + 4, row), Qt::AlignVCenter, QString::fromStdString(c->name));
    y += row;
  }
}

void ProfilePlot::draw_measure(QPainter& painter) const {
  if (points_mm_.empty()) return;
  painter.setPen(QPen(kMeasure, 1.8));
  painter.setBrush(kMeasure);
  QPolygonF line;
  for (const auto& p : points_mm_) {
    line << to_widget(p);
    painter.drawEllipse(to_widget(p), 3, 3);
  }
  painter.setBrush(Qt::NoBrush);
  painter.drawPolyline(line);
  if (measured_.isEmpty()) return;
  painter.setFont(QFont(font().family(), 10, QFont::Bold));
  QRectF box = painter.fontMetrics().boundingRect(measured_);
  box.moveTopLeft(line.last() + QPointF(9, -22));
  box.moveLeft(std::clamp(box.left(), 4.0, width() - box.width() - 8));
  box.moveTop(std::max(box.top(), 4.0));
  painter.fillRect(box.adjusted(-3, -1, 3, 1), QColor(255, 255, 255, 235));
  painter.drawText(box, Qt::AlignCenter, measured_);
}

void ProfilePlot::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.fillRect(rect(), Qt::white);
  bool empty = true;
  for (const PlotCurve& c : curves_) empty &= c.lines.empty();
  if (empty && !note_.isEmpty()) {
    painter.setPen(kTick);
    painter.drawText(rect().adjusted(20, 20, -20, -20), Qt::AlignCenter | Qt::TextWordWrap, note_);
    return;
  }
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
  if (marker_) {
    painter.setPen(QPen(Qt::white, 2));
    painter.setBrush(kInk);
    painter.drawEllipse(to_widget(marker_mm_), 6, 6);
  }
  draw_legend(painter);
  draw_measure(painter);
}

void ProfilePlot::wheelEvent(QWheelEvent* event) {
  const Eigen::Vector2d before = to_mm(event->position());
  px_per_mm_ = std::clamp(px_per_mm_ * std::pow(1.0015, event->angleDelta().y()), 1.0, 500.0);
  centre_mm_ += before - to_mm(event->position());  // the point under the mouse stays
  update();
}

void ProfilePlot::mousePressEvent(QMouseEvent* event) {
  last_mouse_ = event->pos();
  if (!measuring_ || event->button() != Qt::LeftButton) return;
  update();
  if (*measuring_ == Measure::kThickness) return measure_wall(event->localPos());
  if (points_mm_.size() >= clicks_of(*measuring_)) points_mm_.clear();
  const auto near = nearest_curve(event->localPos());
  points_mm_.push_back(near ? near->at_mm : to_mm(event->localPos()));
  measured_.clear();
  if (points_mm_.size() < clicks_of(*measuring_)) return;
  if (*measuring_ == Measure::kDistance) {
    measured_ = QString("%1 mm").arg((points_mm_[1] - points_mm_[0]).norm(), 0, 'f', 2);
  } else {
    const Eigen::Vector2d a = points_mm_[0] - points_mm_[1], b = points_mm_[2] - points_mm_[1];
    const double angle = std::atan2(std::abs(a.x() * b.y() - a.y() * b.x()), a.dot(b));
    measured_ = QString("%1°").arg(angle * 57.29577951308232, 0, 'f', 1);
  }
}

void ProfilePlot::mouseMoveEvent(QMouseEvent* event) {
  const QPoint d = event->pos() - last_mouse_;
  last_mouse_ = event->pos();
  if (measuring_ && (event->buttons() & Qt::LeftButton)) return;
  centre_mm_ += Eigen::Vector2d(-d.x(), d.y()) / px_per_mm_;
  update();
}

}  // namespace gnathion
