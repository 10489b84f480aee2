#include "viewer/widgets/timeline.h"

#include <QHelpEvent>
#include <QMouseEvent>
#include <QPainter>
#include <QPainterPath>
#include <QToolTip>
#include <QWheelEvent>
#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

constexpr int kLeft = 46, kRight = 12, kTop = 20, kBottom = 32, kRestBar = 8;
const QColor kHandInk(28, 36, 48), kScaleInk(96, 103, 116), kCurve(0, 92, 150), kRest(120, 94, 170);

}  // namespace

Timeline::Timeline(QWidget* parent) : QWidget(parent) {
  setObjectName("timeline");
  setMinimumHeight(110);
  setToolTip(
      "Click or drag: go there. Shift and drag: choose an interval. "
      "Violet bars: rests that were found; click one to choose it. Wheel: zoom. Double click: all.");
}

void Timeline::set_samples(std::vector<Sample> samples) {
  samples_ = std::move(samples);
  low_mm_ = -1, high_mm_ = 1;
  for (const Sample& s : samples_)
    if (s.valid) low_mm_ = std::min(low_mm_, s.value_mm), high_mm_ = std::max(high_mm_, s.value_mm);
  view_start_s_ = 0;
  view_end_s_ = std::max(0.1, end_s());
  time_s_ = std::min(time_s_, end_s());
  update();
}

void Timeline::set_bands(std::vector<TimelineBand> bands) {
  bands_ = std::move(bands);
  update();
}

void Timeline::set_rests(std::vector<TimelineRest> rests) {
  rests_ = std::move(rests);
  update();
}

double Timeline::rest_bar_y() const {
  return height() - kBottom + 2 + 0.5 * kRestBar;
}

const TimelineRest* Timeline::rest_at(const QPointF& px) const {
  if (std::abs(px.y() - rest_bar_y()) > 0.5 * kRestBar + 2) return nullptr;
  for (const TimelineRest& r : rests_)
    if (px.x() >= x_of(r.start_s) - 2 && px.x() <= x_of(r.end_s) + 2) return &r;
  return nullptr;
}

bool Timeline::event(QEvent* event) {
  if (event->type() == QEvent::ToolTip) {
    const auto* help = static_cast<QHelpEvent*>(event);
    if (const TimelineRest* rest = rest_at(help->pos())) {
      QToolTip::showText(help->globalPos(), rest->tip, this);
      return true;
    }
  }
  return QWidget::event(event);
}

void Timeline::set_time(double time_s) {
  time_s_ = std::clamp(time_s, 0.0, end_s());
  update();
}

void Timeline::set_selection(std::optional<std::pair<double, double>> s) {
  selection_ = s;
  update();
  if (selected) selected();
}

double Timeline::x_of(double t) const {
  return kLeft + (width() - kLeft - kRight) * (t - view_start_s_) / (view_end_s_ - view_start_s_);
}

double Timeline::time_at(double x) const {
  const double s = (x - kLeft) / (width() - kLeft - kRight);
  return std::clamp(view_start_s_ + s * (view_end_s_ - view_start_s_), 0.0, end_s());
}

void Timeline::draw_curve(QPainter& painter) const {
  const double h = height() - kTop - kBottom;
  const auto y_of = [&](double mm) { return kTop + h * (mm - low_mm_) / (high_mm_ - low_mm_); };
  QPainterPath path;
  bool pen_down = false;
  double gap_from = -1;
  const QColor gap(190, 196, 205);
  for (const Sample& s : samples_) {
    if (!s.valid) {
      if (gap_from < 0) gap_from = s.time_s;
      pen_down = false;
      continue;
    }
    if (gap_from >= 0) {
      painter.fillRect(QRectF(x_of(gap_from), kTop, std::max(1.5, x_of(s.time_s) - x_of(gap_from)), h),
                       QBrush(gap, Qt::BDiagPattern));
      gap_from = -1;
    }
    const QPointF p(x_of(s.time_s), y_of(s.value_mm));
    if (pen_down)
      path.lineTo(p);
    else
      path.moveTo(p);
    pen_down = true;
  }
  painter.setPen(QPen(kCurve, 1.6));
  painter.drawPath(path);
}

void Timeline::draw_axis(QPainter& painter) const {
  painter.setFont(QFont(font().family(), 8));
  const double h = height() - kTop - kBottom;
  double step = 0.1;
  for (const double s : {0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 300.0})
    if ((step = s) * (width() - kLeft - kRight) / (view_end_s_ - view_start_s_) >= 55) break;
  for (double t = std::ceil(view_start_s_ / step) * step; t <= view_end_s_ + 1e-9; t += step) {
    painter.setPen(QColor(226, 229, 234));
    painter.drawLine(QPointF(x_of(t), kTop), QPointF(x_of(t), kTop + h));
    painter.setPen(kScaleInk);
    const QString text = QString::number(t, 'f', step < 1 ? 1 : 0) + " s";
    painter.drawText(QRectF(x_of(t) - 30, height() - 16, 60, 14), Qt::AlignCenter, text);
  }
  painter.setPen(kScaleInk);
  const int every = high_mm_ - low_mm_ > 25 ? 10 : high_mm_ - low_mm_ > 12 ? 5 : 2;
  for (int mm = 0; mm <= high_mm_; mm += every) {
    const double y = kTop + h * (mm - low_mm_) / (high_mm_ - low_mm_);
    painter.drawText(QRectF(2, y - 7, kLeft - 8, 14), Qt::AlignRight | Qt::AlignVCenter,
                     mm == 0 ? "0 mm" : QString::number(mm));
  }
}

/// Bands that follow closely share the height of the labels: a label that would cover another is left out.
void Timeline::draw_bands(QPainter& painter) const {
  const double h = height() - kTop - kBottom;
  painter.setFont(QFont(font().family(), 8, QFont::DemiBold));
  const QFontMetrics metrics(painter.font());
  double free_from = -1e9;
  for (const TimelineBand& b : bands_) {
    QColor fill = b.color;
    fill.setAlpha(45);
    const QRectF box(x_of(b.start_s), kTop, std::max(2.0, x_of(b.end_s) - x_of(b.start_s)), h);
    painter.fillRect(box, fill);
    const double wide = std::max(box.width(), metrics.horizontalAdvance(b.label) + 6.0);
    if (box.left() < free_from) {
      painter.fillRect(QRectF(box.left(), kTop - 3, box.width(), 3), b.color);
      continue;
    }
    painter.fillRect(QRectF(box.left(), kTop - 16, wide, 15), b.color);
    painter.setPen(Qt::white);
    painter.drawText(QRectF(box.left() + 3, kTop - 16, wide, 15), Qt::AlignLeft | Qt::AlignVCenter, b.label);
    free_from = box.left() + wide;
  }
  for (const TimelineRest& r : rests_)
    painter.fillRect(QRectF(x_of(r.start_s), rest_bar_y() - 0.5 * kRestBar,
                            std::max(3.0, x_of(r.end_s) - x_of(r.start_s)), kRestBar),
                     kRest);
}

void Timeline::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.fillRect(rect(), Qt::white);
  if (samples_.empty()) {
    painter.setPen(kScaleInk);
    painter.drawText(rect().adjusted(12, 0, -12, 0), Qt::AlignCenter | Qt::TextWordWrap,
                     "No motion in this case yet: record one in Capture, or run the case.");
    return;
  }
  draw_axis(painter);
  painter.setClipRect(QRect(kLeft, 0, width() - kLeft - kRight + 1, height()));
  const double h = height() - kTop - kBottom;
  draw_bands(painter);
  painter.setRenderHint(QPainter::Antialiasing);
  draw_curve(painter);
  if (selection_) {
    const QRectF box(x_of(selection_->first), kTop, x_of(selection_->second) - x_of(selection_->first), h);
    painter.setPen(QPen(QColor(200, 120, 0), 1.5));
    painter.setBrush(QColor(230, 159, 0, 50));
    painter.drawRect(box);
  }
  painter.setPen(QPen(kHandInk, 2));
  painter.drawLine(QPointF(x_of(time_s_), kTop - 4), QPointF(x_of(time_s_), kTop + h));
  painter.setBrush(kHandInk);
  painter.drawPolygon(QPolygonF({QPointF(x_of(time_s_) - 6, kTop - 10), QPointF(x_of(time_s_) + 6, kTop - 10),
                                 QPointF(x_of(time_s_), kTop - 1)}));
}

void Timeline::mousePressEvent(QMouseEvent* event) {
  if (samples_.empty() || event->button() != Qt::LeftButton) return;
  if (const TimelineRest* rest = rest_at(event->localPos())) {
    selecting_ = false;
    const auto chosen = std::pair{rest->start_s, rest->end_s};
    set_time(0.5 * (chosen.first + chosen.second));
    if (scrubbed) scrubbed(time_s_);
    return set_selection(chosen);
  }
  selecting_ = event->modifiers() & Qt::ShiftModifier;
  anchor_s_ = time_at(event->localPos().x());
  if (selecting_) return;
  set_time(anchor_s_);
  if (scrubbed) scrubbed(time_s_);
}

void Timeline::mouseMoveEvent(QMouseEvent* event) {
  if (samples_.empty() || !(event->buttons() & Qt::LeftButton)) return;
  const double t = time_at(event->localPos().x());
  if (selecting_) return set_selection(std::pair{std::min(anchor_s_, t), std::max(anchor_s_, t)});
  set_time(t);
  if (scrubbed) scrubbed(time_s_);
}

void Timeline::wheelEvent(QWheelEvent* event) {
  const double t = time_at(event->position().x()), f = std::pow(0.9985, event->angleDelta().y());
  view_start_s_ = std::max(0.0, t - (t - view_start_s_) * f);
  view_end_s_ = std::min(std::max(0.1, end_s()), std::max(view_start_s_ + 0.05, t + (view_end_s_ - t) * f));
  update();
}

void Timeline::mouseDoubleClickEvent(QMouseEvent*) {
  view_start_s_ = 0;
  view_end_s_ = std::max(0.1, end_s());
  update();
}

}  // namespace gnathion
